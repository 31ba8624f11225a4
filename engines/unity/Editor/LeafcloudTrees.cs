// Makes a prefab with a LODGroup of each tree of Leafcloud that is imported into a Unity project.
//
// Copy this file into a folder named Editor, and all GLB files of a bake (--engine unity) into one folder of the project. It needs
// an importer of GLB files such as glTFast or UnityGLTF. NAME.prefab has all levels under one parent; they take over at the
// heights that NAME.glb gives, and cross-fade. Multisampling smooths the edges of leaves where the shader has alpha to mask.
using System;
using System.Collections.Generic;
using System.IO;
using System.Text;
using UnityEditor;
using UnityEngine;

namespace Leafcloud
{
    public class LeafcloudTrees : AssetPostprocessor
    {
        const string First = "_LOD0.glb";
        const string AlphaToMask = "_AlphaToMask";

        static void OnPostprocessAllAssets(
            string[] importedAssets, string[] deletedAssets, string[] movedAssets, string[] movedFromAssetPaths)
        {
            foreach (string path in importedAssets)
            {
                string stem = path.EndsWith(First) ? path.Substring(0, path.Length - First.Length) : null;
                if (stem != null && File.Exists(stem + ".glb"))
                    MakePrefab(stem);
            }
        }

        /// Makes NAME.prefab from NAME.glb and its levels. `stem`: their path without ".glb".
        static void MakePrefab(string stem)
        {
            Node[] trees = Array.FindAll(Read(stem + ".glb").nodes, node => node.extras.MSFT_screencoverage.Length > 0);
            if (trees.Length > 1)
                Debug.LogError("Leafcloud: " + stem + ".glb has several trees: bake each one by itself.");
            if (trees.Length != 1)
                return;
            Node first = trees[0];
            float[] heights = first.extras.MSFT_screencoverage;
            var root = new GameObject(Path.GetFileName(stem));
            try
            {
                var levels = new List<LOD>();
                var copies = new Dictionary<Material, Material>();
                for (int number = 0; number < heights.Length; number++)
                {
                    var asset = AssetDatabase.LoadAssetAtPath<GameObject>(stem + "_LOD" + number + ".glb");
                    if (asset == null)
                    {
                        string file = stem + "_LOD" + number + ".glb";
                        Debug.LogError("Leafcloud: " + file + (File.Exists(file)
                            ? " is not imported: install an importer of GLB files, such as glTFast, then reimport."
                            : " is missing: copy all files of the bake."));
                        return;
                    }
                    var level = (GameObject)PrefabUtility.InstantiatePrefab(asset);
                    level.transform.SetParent(root.transform, false);
                    Renderer[] parts = level.GetComponentsInChildren<Renderer>();
                    foreach (Renderer part in parts)
                        part.sharedMaterials = Array.ConvertAll(part.sharedMaterials, each => Smoothed(each, copies, stem));
                    levels.Add(new LOD(heights[number], parts));
                }
                AddGroup(root, levels.ToArray(), 2f * first.extras.leafcloud.radius * Scale(first));
                PrefabUtility.SaveAsPrefabAsset(root, stem + ".prefab");
            }
            finally
            {
                UnityEngine.Object.DestroyImmediate(root);
            }
        }

        /// Returns a copy of a cutout material with alpha to mask on; any other material itself. Materials of an imported file
        /// cannot be changed.
        static Material Smoothed(Material material, Dictionary<Material, Material> copies, string stem)
        {
            if (!material.HasProperty(AlphaToMask) || !material.IsKeywordEnabled("_ALPHATEST_ON"))
                return material;
            if (!copies.ContainsKey(material))
            {
                var copy = new Material(material);
                copy.SetFloat(AlphaToMask, 1f);
                AssetDatabase.CreateAsset(copy, stem + "_cutout" + copies.Count + ".mat");
                copies[material] = copy;
            }
            return copies[material];
        }

        /// Adds a LODGroup whose heights are those of a sphere with this diameter.
        static void AddGroup(GameObject root, LOD[] levels, float diameter)
        {
            var group = root.AddComponent<LODGroup>();
            group.fadeMode = LODFadeMode.CrossFade;
            group.animateCrossFading = true;
            group.SetLODs(levels);
            group.RecalculateBounds();
            group.size = diameter;
        }

        static float Scale(Node node)
        {
            return node.scale.Length == 3 ? Mathf.Max(Array.ConvertAll(node.scale, Mathf.Abs)) : 1f;
        }

        /// Reads the JSON document of a GLB file.
        static Document Read(string path)
        {
            byte[] content = File.ReadAllBytes(path);
            int size = BitConverter.ToInt32(content, 12);
            return JsonUtility.FromJson<Document>(Encoding.UTF8.GetString(content, 20, size));
        }

        // The parts of a file that are read. JsonUtility needs the names of the JSON.
        [Serializable]
        class Document
        {
            public Node[] nodes = new Node[0];
        }

        [Serializable]
        class Node
        {
            public float[] scale = new float[0];
            public Extras extras = new Extras();
        }

        [Serializable]
        class Extras
        {
            public Numbers leafcloud = new Numbers();
            public float[] MSFT_screencoverage = new float[0];
        }

        [Serializable]
        class Numbers
        {
            public float radius = 1f;
        }
    }
}
