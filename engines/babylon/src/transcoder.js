// KTX2 textures by the transcoder of Basis Universal that comes with @babylonjs/core, in the protocol of Babylon.js's own workers.
import { KhronosTextureContainer2, WorkerPool } from "@babylonjs/core";

/** Milliseconds to wait for the files of the transcoder. */
const PATIENCE = 10000;

/** Promises of the pool of each folder. */
const pools = new Map();

/**
 * Makes Babylon.js read KTX2 textures by the transcoder in `folder`, with the files of @babylonjs/core/assets/Basis. Rejects if the
 * files cannot be read: Babylon.js itself would wait for ever.
 */
export async function useTranscoder(folder) {
  if (!pools.has(folder)) pools.set(folder, newPool(folder));
  try {
    KhronosTextureContainer2.WorkerPool = await pools.get(folder);
  } catch (error) {
    pools.delete(folder);
    throw error;
  }
}

async function newPool(folder) {
  const read = async (name) => {
    const url = new URL(name, new URL(folder.replace(/\/?$/, "/"), document.baseURI));
    const response = await fetch(url, { signal: AbortSignal.timeout(PATIENCE) });
    if (!response.ok) throw new Error(`${url}: ${response.status}`);
    return response;
  };
  const script = await (await read("basis_transcoder.js")).text();
  const program = await (await read("basis_transcoder.wasm")).arrayBuffer();
  const address = URL.createObjectURL(new Blob([`${script}\n(${run})()`], { type: "text/javascript" }));
  const worker = new Worker(address);
  try {
    await new Promise((done, fail) => {
      worker.onerror = ({ message }) => fail(new Error(message));
      worker.onmessage = ({ data }) => (data.error ? fail(new Error(data.error)) : done());
      setTimeout(() => fail(new Error("the transcoder does not start")), PATIENCE);
      worker.postMessage({ action: "init", program }, [program]);
    });
  } catch (error) {
    worker.terminate();
    throw error;
  } finally {
    URL.revokeObjectURL(address);
  }
  return new WorkerPool([worker]);
}

/** Code of the worker. It has nothing of this module; BASIS is the transcoder's script. */
function run() {
  /** Formats by the capability that they need, the best first: the transcoder's number and WebGL's. */
  const FORMATS = [
    ["astc", 10, 0x93b0],
    ["bptc", 6, 0x8e8c],
    ["etc2", 1, 0x9278],
    ["s3tc", 3, 0x83f3],
  ];
  const UNCOMPRESSED = ["", 13, 0x8058];
  let basis;

  const transcoded = (bytes, caps) => {
    const file = new basis.KTX2File(bytes);
    try {
      if (!file.isValid() || !file.startTranscoding()) throw new Error("This is no KTX2 texture of Basis Universal.");
      const [width, height] = [file.getWidth(), file.getHeight()];
      // WebGL reads compressed blocks of 4 × 4 texels.
      const compressed = width % 4 === 0 && height % 4 === 0;
      const [, format, transcodedFormat] = FORMATS.find(([cap]) => compressed && caps[cap]) ?? UNCOMPRESSED;
      const mipmaps = Array.from({ length: file.getLevels() }, (_, level) => {
        const data = new Uint8Array(file.getImageTranscodedSizeInBytes(level, 0, 0, format));
        if (!file.transcodeImage(data, level, 0, 0, format, 0, -1, -1)) throw new Error(`Level ${level} cannot be transcoded.`);
        return { data, width: Math.max(width >> level, 1), height: Math.max(height >> level, 1) };
      });
      return { width, height, transcodedFormat, mipmaps, isInGammaSpace: true, hasAlpha: file.getHasAlpha(), transcoderName: "Basis" };
    } finally {
      file.close();
      file.delete();
    }
  };
  const answers = {
    init: async ({ program }) => {
      basis = await new Promise((done, fail) => {
        const onAbort = (reason) => fail(new Error(`the transcoder's program is broken: ${reason}`));
        const module = { wasmBinary: program, onRuntimeInitialized: () => done(module), onAbort };
        BASIS(module)?.catch?.(fail);
      });
      basis.initializeBasis();
      return { action: "init" };
    },
    decode: ({ data, caps }) => ({ action: "decoded", success: true, decodedData: transcoded(data, caps) }),
  };
  self.onmessage = async ({ data }) => {
    try {
      const answer = await answers[data.action]?.(data);
      if (answer) self.postMessage(answer, answer.decodedData?.mipmaps.map((each) => each.data.buffer) ?? []);
    } catch (error) {
      self.postMessage({ action: "decoded", success: false, msg: error.message, error: error.message });
    }
  };
}
