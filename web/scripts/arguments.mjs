// Numbers of a command line.

/** At least 0. Throws an Error of one sentence, which a person reads. */
export function number(option, text) {
  return checked(option, text, (value) => value >= 0, "a number of at least 0");
}

/** Above 0; throws likewise. */
export function positive(option, text) {
  return checked(option, text, (value) => value > 0, "a number above 0");
}

function checked(option, text, allowed, what) {
  const value = Number(text);
  if (text.trim() === "" || !Number.isFinite(value) || !allowed(value)) {
    throw new Error(`${option} needs ${what}, not “${text}”.`);
  }
  return value;
}
