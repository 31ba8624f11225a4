// The parts of Unity's API that LeafcloudTrees.cs calls, to check its types without Unity. From Unity's manual, 2022.3.
using System;

namespace UnityEngine
{
    public class Object { public static void DestroyImmediate(Object obj) { } }
    public class GameObject : Object
    {
        public GameObject(string name) { }
        public Transform transform { get { return null; } }
        public T AddComponent<T>() where T : Component { return null; }
        public T[] GetComponentsInChildren<T>() { return null; }
    }
    public class Component : Object { }
    public class Transform : Component { public void SetParent(Transform parent, bool worldPositionStays) { } }
    public class Renderer : Component { public Material[] sharedMaterials { get; set; } }
    public class Material : Object
    {
        public Material(Material source) { }
        public bool HasProperty(string name) { return false; }
        public bool IsKeywordEnabled(string keyword) { return false; }
        public void SetFloat(string name, float value) { }
    }
    public struct LOD { public LOD(float screenRelativeTransitionHeight, Renderer[] renderers) { } }
    public enum LODFadeMode { None, CrossFade, SpeedTree }
    public class LODGroup : Component
    {
        public LODFadeMode fadeMode { get; set; }
        public bool animateCrossFading { get; set; }
        public float size { get; set; }
        public void SetLODs(LOD[] lods) { }
        public void RecalculateBounds() { }
    }
    public static class Debug { public static void LogError(object message) { } }
    public static class JsonUtility { public static T FromJson<T>(string json) { return default(T); } }
    public static class Mathf { public static float Max(params float[] values) { return 0f; } public static float Abs(float f) { return 0f; } }
}

namespace UnityEditor
{
    using UnityEngine;

    public class AssetPostprocessor { }
    public static class AssetDatabase
    {
        public static T LoadAssetAtPath<T>(string path) where T : Object { return null; }
        public static void CreateAsset(Object asset, string path) { }
    }
    public static class PrefabUtility
    {
        public static Object InstantiatePrefab(Object asset) { return null; }
        public static GameObject SaveAsPrefabAsset(GameObject root, string path) { return null; }
    }
}
