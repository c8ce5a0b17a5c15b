// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { LocalOptions, LocalPlayer } from "../local/local-player";
import { changeSettings, settings } from "../state/app";
import { COURTYARD } from "../state/fake-server";
import { DEFAULT_SETTINGS } from "../state/settings";
import type { SceneInfo } from "../wire/render";
import { keepDownload } from "./download-opening";

const opened = vi.hoisted(() => [] as { options: { url: string; form: string }; disposed: boolean }[]);
vi.mock("../local/local-player", () => ({
  LocalPlayer: class {
    disposed = false;
    options: { url: string; form: string };
    constructor(options: { url: string; form: string }) {
      this.options = options;
      opened.push(this);
    }
    dispose() {
      this.disposed = true;
    }
  },
}));

const current = signal<LocalPlayer | null>(null);
const scene = signal<SceneInfo | null>(null);
let stop: () => void;

beforeEach(() => {
  opened.length = 0;
  settings.value = DEFAULT_SETTINGS;
  scene.value = { ...COURTYARD, downloads: [{ form: "ply" }, { form: "compressed" }] };
  stop = keepDownload(current, scene, {} as LocalOptions);
});

afterEach(() => stop());

const state = () => opened.map(({ options, disposed }) => [options.url, disposed]);

test("there is a download in the mode that needs one, and none before or after", () => {
  expect(current.value).toBeNull();
  changeSettings({ mode: "local" });
  expect(state()).toEqual([["scenes/courtyard/download/compressed", false]]);
  changeSettings({ turnSpeed: 90 });
  changeSettings({ localForm: "ply" });
  expect(state()).toEqual([
    ["scenes/courtyard/download/compressed", true],
    ["scenes/courtyard/download/ply", false],
  ]);
  changeSettings({ mode: "stateless" });
  expect([opened.at(-1)?.disposed, current.value]).toEqual([true, null]);
});

test("a form that is not offered gives way to one that is; a scene that is not offered is not asked for", () => {
  scene.value = { ...COURTYARD, downloads: [{ form: "ply" }] };
  changeSettings({ mode: "local", localForm: "compressed" });
  expect(opened.at(-1)?.options.form).toBe("ply");
  scene.value = COURTYARD;
  expect([current.value, opened.length]).toEqual([null, 1]);
});
