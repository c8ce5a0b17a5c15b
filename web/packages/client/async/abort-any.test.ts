import { expect, test } from "vitest";
import { anyOf } from "./abort-any";

test("a signal of several is aborted with the first of them, for its reason", () => {
  const [first, second] = [new AbortController(), new AbortController()];
  const either = anyOf([first.signal, second.signal]);
  expect(either.aborted).toBe(false);
  second.abort("late");
  first.abort("later");
  expect([either.aborted, either.reason]).toEqual([true, "late"]);
});

test("a signal of one that was aborted before is aborted at once", () => {
  expect(anyOf([new AbortController().signal, AbortSignal.abort("before")]).reason).toBe("before");
});
