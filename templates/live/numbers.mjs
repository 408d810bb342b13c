// Numbers as they are read and typed, and sliders whose positions are those of numbers.

/** A number with so many digits that count, in a form that reads well. */
export function shown(value, digits = 4) {
  if (!Number.isFinite(value)) return String(value);
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(Math.max(digits - 2, 0)).replace(/\.?0+e/, "e").replace("e+", "e");
  return String(Number(value.toPrecision(digits)));
}

/** The number that a text says; NaN where it says none. */
export function parsed(text) {
  const plain = String(text).trim().replace(",", ".");
  return plain === "" ? NaN : Number(plain);
}

/**
 * A slider of positions 0 to 1 for numbers from low to high.  Logarithmic where `log` is set: then low is above 0, and
 * where `zero` is set, too, position 0 is 0.
 */
export function sliderScale({ low, high, log = false, zero = false }) {
  const inside = (x) => Math.min(Math.max(x, 0), 1);
  if (!log) {
    const span = high - low || 1;
    return { toValue: (at) => low + inside(at) * span, toPosition: (value) => inside((value - low) / span) };
  }
  const span = Math.log(high / low) || 1;
  return {
    toValue: (at) => (zero && at <= 0 ? 0 : low * Math.exp(inside(at) * span)),
    toPosition: (value) => (value > 0 ? inside(Math.log(value / low) / span) : 0),
  };
}

/** Bytes of a text in base64. */
export function bytesOf(text) {
  const plain = atob(text);
  const found = new Uint8Array(plain.length);
  for (let i = 0; i < plain.length; i++) found[i] = plain.charCodeAt(i);
  return found;
}

/** Numbers of single precision, little-endian, in base64. */
export const floatsOf = (text) => new Float32Array(bytesOf(text).buffer);

/** Numbers of double precision, little-endian, in base64. */
export const doublesOf = (text) => new Float64Array(bytesOf(text).buffer);
