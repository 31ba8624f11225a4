// Mip levels of cut-out textures in which alpha is the share of drawn texels (shaders/shares.glsl reads them).
//
// Box-filtered alpha falls below the cutoff where leaves are thin, so that they dissolve in the distance. Without mip levels they
// flicker. Colors are means of drawn texels, as light. O(texels).

/** Places along a texel's side at which alpha is compared with the cutoff: of pictures of up to `MANY` texels, and of larger ones. */
const [PLACES, FEWER_PLACES, MANY] = [4, 2, 2 ** 20];

const LIGHT = Float32Array.from({ length: 256 }, (_, code) => {
  const share = code / 255;
  return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
});

function codeOf(light) {
  return 255 * (light <= 0.0031308 ? 12.92 * light : 1.055 * light ** (1 / 2.4) - 0.055);
}

/**
 * Returns the mip levels {data, width, height} of a picture of such form, without the picture itself, the largest first. `data`: four
 * codes a texel, the first three sRGB. `cutoff`: least alpha in [0, 1] that is drawn.
 */
export function shareMips({ data, width, height }, cutoff) {
  const levels = [];
  let sums = drawnTexels(data, width, height, 255 * cutoff);
  while (sums.width > 1 || sums.height > 1) levels.push((sums = halved(sums)));
  levels.reverse().forEach((level, i) => divide(level, levels[i - 1]));
  return levels.reverse().map(coded);
}

/** Returns four numbers a texel: the share of it that is drawn, as filtered alpha decides, and its light times this share. */
function drawnTexels(data, width, height, cutoff) {
  const numbers = new Float32Array(data.length);
  const offsets = offsetsOf(width * height > MANY ? FEWER_PLACES : PLACES);
  for (let y = 0, at = 0; y < height; y++) {
    const rows = [y > 0 ? y - 1 : height - 1, y, y + 1 < height ? y + 1 : 0].map((row) => 4 * row * width + 3);
    for (let x = 0; x < width; x++, at += 4) {
      const columns = [4 * (x > 0 ? x - 1 : width - 1), 4 * x, 4 * (x + 1 < width ? x + 1 : 0)];
      const share = shareOf(data, rows, columns, cutoff, offsets);
      if (share === 0) continue;
      for (let channel = 0; channel < 3; channel++) numbers[at + channel] = share * LIGHT[data[at + channel]];
      numbers[at + 3] = share;
    }
  }
  return { numbers, width, height };
}

/** Returns evenly spaced places in a texel: offsets from its center, in texels. */
function offsetsOf(count) {
  return Array.from({ length: count }, (_, i) => (i + 0.5) / count - 0.5);
}

/** Returns the share of a texel's places at which alpha, filtered between centers of texels, reaches the cutoff. */
function shareOf(data, rows, columns, cutoff, offsets) {
  let [least, most] = [255, 0];
  for (const row of rows) {
    for (const column of columns) {
      const code = data[row + column];
      if (code < least) least = code;
      if (code > most) most = code;
    }
  }
  if (most < cutoff) return 0;
  if (least >= cutoff) return 1;
  let drawn = 0;
  for (const down of offsets) {
    const [row, nextRow, v] = [rows[1], rows[down < 0 ? 0 : 2], Math.abs(down)];
    for (const right of offsets) {
      const [column, next, u] = [columns[1], columns[right < 0 ? 0 : 2], Math.abs(right)];
      const here = data[row + column] * (1 - u) + data[row + next] * u;
      const beside = data[nextRow + column] * (1 - u) + data[nextRow + next] * u;
      if (here * (1 - v) + beside * v >= cutoff) drawn++;
    }
  }
  return drawn / offsets.length ** 2;
}

/** Returns means of 2 × 2 texels. The last row and column of an odd size are left out, as OpenGL rounds sizes down. */
function halved({ numbers, width: columns, height: rows }) {
  const [width, height] = [Math.max(columns >> 1, 1), Math.max(rows >> 1, 1)];
  const [right, below] = [columns > 1 ? 4 : 0, rows > 1 ? 4 * columns : 0];
  const means = new Float32Array(4 * width * height);
  for (let y = 0, to = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const from = 4 * (2 * y * columns + 2 * x);
      for (let end = from + 4, at = from; at < end; at++, to++) {
        means[to] = 0.25 * (numbers[at] + numbers[at + right] + numbers[at + below] + numbers[at + below + right]);
      }
    }
  }
  return { numbers: means, width, height };
}

/** Divides light by the share of drawn texels. Texels without any take the light of the next smaller level: filters mix them in. */
function divide(level, smaller) {
  const { numbers, width, height } = level;
  for (let y = 0, at = 0; y < height; y++) {
    for (let x = 0; x < width; x++, at += 4) {
      const drawn = numbers[at + 3];
      const row = smaller ? Math.min(y >> 1, smaller.height - 1) : 0;
      const from = smaller ? 4 * (row * smaller.width + Math.min(x >> 1, smaller.width - 1)) : at;
      for (let channel = 0; channel < 3; channel++) {
        numbers[at + channel] = drawn > 0 ? numbers[at + channel] / drawn : (smaller ?? level).numbers[from + channel];
      }
    }
  }
}

function coded({ numbers, width, height }) {
  const data = new Uint8ClampedArray(numbers.length);
  for (let i = 0; i < data.length; i += 4) {
    for (let channel = 0; channel < 3; channel++) data[i + channel] = codeOf(numbers[i + channel]);
    data[i + 3] = 255 * numbers[i + 3];
  }
  return { data, width, height };
}
