// Reads KTX2 as three.js does: node transcode.mjs THREE FILE.ktx2 OUT writes each level's RGBA, row 0 on top, to
// OUT/<number>. THREE is the folder of the package three.
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";

const RGBA32 = 13;
const [, , three, path, out] = process.argv;
const basis = join(three, "examples", "jsm", "libs", "basis", "basis_transcoder");
// A script of before modules, in a package of modules.
const scope = { exports: {} };
new Function("module", "exports", "require", "__dirname", "__filename", readFileSync(`${basis}.js`, "utf8"))(
    scope, scope.exports, () => ({}), "", "",
);
const { initializeBasis, KTX2File } = await scope.exports({ wasmBinary: readFileSync(`${basis}.wasm`) });
initializeBasis();
const file = new KTX2File(new Uint8Array(readFileSync(path)));
if (!file.isValid() || !file.startTranscoding()) throw new Error(`${path} is no KTX2 that three.js can read`);
for (let number = 0; number < file.getLevels(); number++) {
    const pixels = new Uint8Array(file.getImageTranscodedSizeInBytes(number, 0, 0, RGBA32));
    if (!file.transcodeImage(pixels, number, 0, 0, RGBA32, 0, -1, -1)) throw new Error(`level ${number} cannot be read`);
    writeFileSync(join(out, `${number}`), pixels);
}
