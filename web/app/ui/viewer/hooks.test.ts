import { expect, test } from "vitest";
import { actionOf } from "./hooks";

test.each([
  ["QWERTY", "r", "KeyR", "reset"],
  ["Cyrillic", "р", "KeyH", "help"],
  ["Colemak, where S types r", "r", "KeyS", undefined],
  ["Dvorak, where S types o", "o", "KeyS", undefined],
  ["US", "?", "Slash", "help"],
  ["German", "?", "Minus", "help"],
  ["French, where M and ? are one key", "?", "KeyM", "help"],
  ["Arabic", "؟", "Slash", "help"],
])("%s: %s on the key %s means %s", (_, key, code, action) => {
  expect(actionOf({ key, code })).toBe(action);
});
