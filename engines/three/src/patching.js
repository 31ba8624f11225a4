// Text edits of three.js's shaders, by the line to change.

export function before(place, what, source) {
  return replaced(source, place, `${what}\n${place}`);
}

export function after(place, what, source) {
  return replaced(source, place, `${place}\n${what}`);
}

/** Replaces `place` in the source by `what`. Throws if three.js has changed its shaders, instead of drawing wrongly. */
export function replaced(source, place, what) {
  if (!source.includes(place)) throw new Error(`three.js's shader has no ${place}: use package.json's version`);
  return source.replace(place, () => what);
}
