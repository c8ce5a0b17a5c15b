// Numbers of a command line.

/** At least 0. Throws an Error of one sentence, which a person reads. */
export function number(option, text) {
  const value = Number(text);
  if (text.trim() === "" || !Number.isFinite(value) || value < 0) {
    throw new Error(`${option} needs a number of at least 0, not “${text}”.`);
  }
  return value;
}
