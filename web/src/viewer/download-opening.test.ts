// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { LocalOptions, LocalPlayer } from "../local/local-player";
import { changeSettings, config, settings } from "../state/app";
import { COURTYARD } from "../state/fake-server";
import { DEFAULT_SETTINGS } from "../state/settings";
import type { SceneInfo, ServerConfig } from "../wire/render";
import { keepDownload } from "./download-opening";

const opened = vi.hoisted(() => [] as { options: { url: () => string }; disposed: boolean }[]);
vi.mock("../local/local-player", () => ({
  LocalPlayer: class {
    disposed = false;
    options: { url: () => string };
    constructor(options: { url: () => string }) {
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
  config.value = null;
  scene.value = { ...COURTYARD, downloads: [{}] };
  stop = keepDownload(current, scene, settings, {} as LocalOptions);
});

afterEach(() => {
  stop();
  vi.unstubAllGlobals();
});

const state = () => opened.map(({ options, disposed }) => [options.url(), disposed]);

test("there is a download in the mode that needs one, and none before or after", () => {
  expect(current.value).toBeNull();
  changeSettings({ mode: "local" });
  expect(state()).toEqual([["scenes/courtyard/download/compressed", false]]);
  changeSettings({ turnSpeed: 90 });
  expect(state()).toEqual([["scenes/courtyard/download/compressed", false]]);
  changeSettings({ mode: "stateless" });
  expect([state(), current.value]).toEqual([[["scenes/courtyard/download/compressed", true]], null]);
});

test("in a cluster, a scene is downloaded from the host that the page is at by then", () => {
  vi.stubGlobal("location", new URL("http://lab.test:8080/"));
  config.value = { host: "east", render_url: "http://10.0.0.2:8080" } as ServerConfig;
  changeSettings({ mode: "local" });
  expect(opened[0]?.options.url()).toBe("http://10.0.0.2:8080/scenes/courtyard/download/compressed");
  vi.stubGlobal("location", new URL("https://lab.test/"));
  config.value = { host: "west", render_url: "http://10.0.0.3:8080" } as ServerConfig;
  expect(opened[0]?.options.url()).toBe("scenes/courtyard/download/compressed?host=west");
});

test("a scene that is not offered is not asked for", () => {
  scene.value = COURTYARD;
  changeSettings({ mode: "local" });
  expect([current.value, opened.length]).toEqual([null, 0]);
  scene.value = { ...COURTYARD, downloads: [{}] };
  expect([current.value, opened.length]).toEqual([opened[0], 1]);
});
