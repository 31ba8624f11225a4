// The laws of levels that a processor needs, for any engine; glsl.js has those of the shaders.

/** The a at which the next level takes over: at 1 itself overlapping leaves have almost no depth order. */
export const HAND_OVER = 0.998;

/** A distance that no camera reaches. */
export const NEVER = 1e9;

/** tan(½ fov) / pixels of the view that a file's distances are for: 50° over 1080 pixels. */
const FILE_VIEW = Math.tan((25 * Math.PI) / 180) / 1080;

/** LC_PLACE_TURNS of leafcloud.glsl. */
export const PLACE_TURNS = [0.1732, 0.2236, -0.1414];

/** LC_STAGGER_TURNS of leafcloud.glsl. */
export const STAGGER_TURNS = [0.7549, 0.4387, -0.5698];

/** 1 + s·w(t), lc_stagger of leafcloud.glsl. `place`: [x, y, z] in the world. */
export function staggerAt(place, amount) {
  const turns = place.reduce((sum, each, axis) => sum + each * STAGGER_TURNS[axis], 0) - 0.25;
  return 1 + amount * (4 * Math.abs(turns - Math.floor(turns) - 0.5) - 1);
}

/** clamp((d − start) / (end − start), 0, 1), as in leafcloud.glsl. */
export function transitionAt(distance, start, end) {
  return Math.min(Math.max((distance - start) / Math.max(end - start, 1e-30), 0), 1);
}

/** min((d₀/d)^(log_h ½), 1), as in leafcloud.glsl. */
export function keepAt(distance, start, half) {
  return (start / Math.max(distance, start)) ** (Math.log(0.5) / Math.log(half));
}

/** σ = S / (|S| + 4), as in leafcloud.glsl. */
export function windForce(strength) {
  return strength / (Math.abs(strength) + 4);
}

/** C(rank): the fraction of the leaves' area with a lower rank, from the table of 65 `shares`, as in leafcloud.glsl. */
function shareBelow(rank, shares) {
  const last = shares.length - 1;
  const i = Math.min(Math.max(Math.trunc(Math.sqrt(rank) * last), 0), last - 1);
  const [below, above] = [(i / last) ** 2, ((i + 1) / last) ** 2];
  const within = Math.min(Math.max((rank - below) / (above - below), 0), 1);
  return shares[i] + (shares[i + 1] - shares[i]) * within;
}

/** s = √(ΣA / Σ(A·r²)), lc_area_scale of leafcloud.glsl. */
export function areaScale(keep, shares) {
  const whole = shareBelow(keep * (1 - Math.min(0.05, 1 - keep)), shares);
  const drawn = whole + (shareBelow(keep, shares) - whole) / 3;
  return keep < 1 && drawn > 0 ? 1 / Math.sqrt(drawn) : 1;
}

/** exp(c₁ L + c₂ L²), L = ln λ, lc_trend of leafcloud.glsl. */
export function trend(keep, [linear, square]) {
  const logarithm = Math.log(Math.max(keep, 1e-30));
  return keep > 0 && keep < 1 ? Math.exp(logarithm * (linear + square * logarithm)) : 1;
}

/**
 * Returns the factor on a file's distances at which levels take over at the size in pixels for which they were baked.
 * `fov`: the vertical field of view in radians; null for other projections. `pixels`: the height of the picture; null: as the
 * file says.
 */
export function viewFactor(fov, { lodDistance, pixels }) {
  if (pixels === null || fov === null) return lodDistance;
  return (lodDistance * FILE_VIEW * pixels) / Math.tan(fov / 2);
}
