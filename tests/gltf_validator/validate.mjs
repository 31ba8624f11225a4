// Validates GLB files with the Khronos glTF validator.
//
//   node validate.mjs FILE.glb …
//
// Prints one JSON object: for each path its list of issues, each {code, message, severity, pointer},
// where severity is 0 for an error, 1 a warning, 2 an information, 3 a hint. All issues are listed.
// The exit status is 0 when every file could be read and checked, whatever was found in it.
import { readFileSync } from "node:fs";
import validator from "gltf-validator";

const issues = {};
for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(path)), { uri: path, maxIssues: 0 });
  issues[path] = report.issues.messages;
}
console.log(JSON.stringify(issues));
