// The laws of leafcloud.glsl as nodes, with the same names: TSL has no way to read GLSL for both of WebGPURenderer's
// backends. Arguments and results are nodes; shaders/leafcloud.glsl explains each law.
import {
  abs,
  bool,
  clamp,
  cos,
  cross,
  dot,
  exp,
  exp2,
  float,
  floor,
  fract,
  int,
  inverseSqrt,
  length,
  log,
  log2,
  max,
  min,
  mix,
  round,
  select,
  sin,
  sqrt,
  vec2,
  vec3,
} from "three/tsl";
import { PLACE_TURNS, STAGGER_TURNS } from "../laws.js";

/** Entries of the table of areas. */
export const SHARES = 65;
const RAMP = 0.05;
const TINY = 1e-30;
const TURN = 2 * Math.PI;
/** Minimum half width of a shadow's edge. */
const EDGE = 0.1;

export function transitionOf(distance, start, end) {
  return clamp(distance.sub(start).div(max(end.sub(start), TINY)), 0, 1);
}

export function staggerOf(place, amount) {
  const turns = fract(dot(place, vec3(...STAGGER_TURNS)).sub(0.25));
  return abs(turns.sub(0.5)).mul(4).sub(1).mul(amount).add(1);
}

export function keepOf(distance, start, half) {
  const nearness = start.div(max(distance, start));
  return select(nearness.lessThan(1), exp2(log2(nearness).negate().div(log2(half))), 1);
}

function rampOf(rank, keep) {
  const width = min(RAMP, keep.oneMinus()).mul(keep);
  const within = clamp(keep.sub(rank).div(max(width, TINY)), 0, 1);
  return select(rank.lessThan(0), 1, select(rank.lessThan(keep), within, 0));
}

function shareBelow(rank, shares) {
  const last = SHARES - 1;
  const i = clamp(floor(sqrt(rank).mul(last)), 0, last - 1);
  const [below, above] = [i, i.add(1)].map((each) => each.mul(each).div(last * last));
  const within = clamp(rank.sub(below).div(above.sub(below)), 0, 1);
  return mix(shares.element(int(i)), shares.element(int(i).add(1)), within);
}

export function areaScale(keep, shares) {
  const whole = shareBelow(keep.mul(min(RAMP, keep.oneMinus()).oneMinus()), shares);
  const drawn = mix(whole, shareBelow(keep, shares), 1 / 3);
  return select(keep.lessThan(1).and(drawn.greaterThan(0)), inverseSqrt(max(drawn, TINY)), 1);
}

export function trendOf(keep, numbers) {
  const logarithm = log(max(keep, TINY));
  const factor = exp(logarithm.mul(numbers.x.add(numbers.y.mul(logarithm))));
  return select(keep.greaterThan(0).and(keep.lessThan(1)), factor, 1);
}

export function growthOf(rank, keep, scale) {
  return select(rank.lessThan(0), 1, scale.mul(rampOf(rank, keep)));
}

export function placeOf(position, target, pivot, pivotTarget, transition, growth) {
  const point = mix(position, target, transition);
  const centre = mix(pivot, pivotTarget, transition);
  return select(growth.equal(1), point, centre.add(point.sub(centre).mul(growth)));
}

/** The angle of `turns` in [−π, π]. */
function angleOf(turns) {
  return turns.sub(round(turns)).mul(TURN);
}

/** Turns of the wind by a tree's place in the world. */
export function turnsAt(place) {
  return dot(vec3(...PLACE_TURNS), place);
}

/** `wind` is an object of nodes, with the members of LcWind. */
function swayOf(point, pivot, wind) {
  const arm = pivot.sub(wind.foot);
  const beyond = point.sub(pivot);
  const rise = dot(wind.up, arm);
  const eta = max(rise, 0).div(wind.height);
  const outward = arm.sub(wind.up.mul(rise)).div(wind.spread);
  const waves = wind.direction.add(cross(wind.up, wind.direction)).mul(2);
  const angle = angleOf(wind.turns.mul(2.3).sub(dot(waves, arm).div(wind.spread.mul(TURN))));
  const square = dot(outward, outward);

  const bend = eta.mul(eta.add(dot(wind.up, beyond).mul(2).div(wind.height)));
  const reach = square.add(dot(outward, beyond).mul(2).div(wind.spread));
  const twig = reach.mul(sin(angle)).sub(square.mul(dot(waves, beyond)).div(wind.spread).mul(cos(angle)));
  const gust = sin(angleOf(wind.turns)).mul(0.6).add(sin(angleOf(wind.turns.mul(0.618))).mul(0.4));
  const lean = wind.sway.mul(wind.height).mul(wind.gusts.oneMinus().add(wind.gusts.mul(gust)));
  const swing = wind.direction.add(wind.up).mul(wind.branches.mul(wind.spread).mul(twig).mul(0.5));
  return wind.direction.mul(lean.mul(bend)).add(swing).mul(wind.force);
}

export function flutterOf(point, pivot, phase, freedom, transition, wind) {
  const across = cross(wind.up, wind.direction);
  const along = sin(angleOf(wind.turns.mul(5).add(phase)));
  const beside = sin(angleOf(wind.turns.mul(6.9).add(phase.mul(3))));
  const axis = wind.direction.mul(along).add(across.mul(beside)).mul(Math.SQRT1_2);
  const size = length(axis);
  const angle = abs(wind.force).mul(wind.flutter).mul(freedom).mul(transition.oneMinus()).mul(size);
  const n = axis.div(max(size, TINY));
  const arm = point.sub(pivot);
  const lifted = n.mul(dot(n, arm).mul(cos(angle).oneMinus()));
  const turned = pivot.add(arm.mul(cos(angle))).add(cross(n, arm).mul(sin(angle))).add(lifted);
  return select(angle.equal(0), point, turned);
}

export function blownOf(point, pivot, billboardPivot, transition, wind) {
  const offset = mix(swayOf(point, pivot, wind), swayOf(point, billboardPivot, wind), transition);
  return select(wind.force.equal(0), point, point.add(offset));
}

/** The same for a point without a leaf. */
export function blownAlone(point, wind) {
  return select(wind.force.equal(0), point, point.add(swayOf(point, point, wind)));
}

export function towardMean(color, mean, keep, numbers) {
  const contrast = min(trendOf(keep, numbers), 1);
  return select(contrast.equal(1), color, mean.add(color.sub(mean).mul(contrast)));
}

function gapShare(open, toward, along) {
  const cosine = along.div(max(toward, TINY));
  const reach = float(3).sub(toward.div(max(open, TINY)));
  const wide = open.mul(4).div(reach.mul(reach)).mul(max(cosine.sub(1).add(reach), 0));
  const edge = max(sqrt(max(open.mul(open.oneMinus()).mul(3).sub(toward), 0)).mul(2), EDGE);
  const narrow = clamp(cosine.sub(1).add(open.mul(2)).div(edge).mul(0.5).add(0.5), 0, 1);
  return select(toward.lessThanEqual(open), open.add(along), select(reach.greaterThanEqual(open.mul(4)), wide, narrow));
}

export function sunShare(open, toward, light) {
  const most = open.greaterThan(0.5);
  const along = dot(toward, light);
  const gap = gapShare(select(most, open.oneMinus(), open), length(toward), select(most, along.negate(), along));
  return select(most, gap.oneMinus(), gap);
}

export function isShown(share, pixel) {
  return bool(fract(fract(dot(pixel, vec2(0.06711056, 0.00583715))).mul(52.9829189)).lessThan(share));
}
