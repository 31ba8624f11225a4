// Trees with levels of detail that do not pop, for Babylon.js. README.md has an example.
export { loadTree, SETTINGS, Tree } from "./tree.js";
