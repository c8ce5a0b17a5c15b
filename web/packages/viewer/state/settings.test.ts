import { expect, test } from "vitest";
import { DEFAULT_SETTINGS, loadSettings, saveSettings } from "./settings";

function store(content: string | null) {
  return {
    content,
    getItem(): string | null {
      return this.content;
    },
    setItem(_: string, value: string): void {
      this.content = value;
    },
  };
}

test("settings come back as they were saved", () => {
  const disk = store(null);
  const mine = {
    ...DEFAULT_SETTINGS,
    theme: "dark",
    profile: 2,
    transport: "fetch",
    turnSpeed: 90,
    sidebar: false,
  } as const;
  saveSettings(() => disk, mine);
  expect(loadSettings(() => disk)).toEqual(mine);
});

test.each([
  ["nothing", null],
  ["no JSON", "{theme:"],
  ["no object", "17"],
  ["null", "null"],
])("%s gives the defaults", (_, content) => {
  expect(loadSettings(() => store(content))).toEqual(DEFAULT_SETTINGS);
});

test("one value that makes no sense does not cost the others", () => {
  const content = JSON.stringify({ theme: "purple", profile: -1, turnSpeed: "fast", refine: false, unknown: 1 });
  expect(loadSettings(() => store(content))).toEqual({ ...DEFAULT_SETTINGS, refine: false });
});

test("a predictor that is gone gives way to the default", () => {
  const content = JSON.stringify({ prediction: "auto", refine: false });
  expect(loadSettings(() => store(content))).toMatchObject({ prediction: "velocity", refine: false });
});

test("a browser that forbids storage still works", () => {
  const forbidden = () => {
    throw new DOMException("denied", "SecurityError");
  };
  expect(loadSettings(forbidden)).toEqual(DEFAULT_SETTINGS);
  expect(() => saveSettings(forbidden, DEFAULT_SETTINGS)).not.toThrow();
});
