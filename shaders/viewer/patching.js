// Changes to three.js's shaders, by the places that they name.

export function before(place, what, source) {
  return replaced(source, place, `${what}\n${place}`);
}

export function after(place, what, source) {
  return replaced(source, place, `${place}\n${what}`);
}

/** Fails where three.js has changed its shaders, instead of drawing something else. */
export function replaced(source, place, what) {
  if (!source.includes(place)) throw new Error(`three.js's shader has no ${place}`);
  return source.replace(place, () => what);
}
