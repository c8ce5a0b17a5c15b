// @vitest-environment happy-dom
import { act, cleanup, render, screen } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test } from "vitest";
import { serverConfig } from "#fakes/server";
import { asSession, type FakeSession, fakeSession } from "#fakes/session";
import { FakeTransport } from "#fakes/transport";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { NO_STATS, type Stats } from "#viewer/stateless/stats";
import { config, settings } from "../../state/app";
import { Hud } from "./hud";

const STATS: Stats = {
  ...NO_STATS,
  newViewsPerSecond: 41.6,
  motionToPhoton: { p50: 48.4, p95: 96.2 },
  roundTrip: 31.2,
  server: { queue: 1, render: 11.4, encode: 2.3 },
  throughput: 24_300_000,
  frame: { bytes: 52_000, width: 960, height: 540, profile: 1 },
  transport: "webtransport-streams",
  inFlight: 2,
  counts: { sent: 9, cancelled: 3, dropped: 4 },
  shown: 7,
  settled: false,
};
let session: FakeSession;

beforeEach(() => {
  settings.value = DEFAULT_SETTINGS;
  config.value = serverConfig();
  session = fakeSession();
});

afterEach(cleanup);

const show = (stats: Partial<Stats> = {}) => {
  session.pictures.stats.value = { ...STATS, ...stats };
  const { pictures } = session;
  const Shown = () => <Hud session={asSession(session)} source={pictures} stats={pictures.stats.value} />;
  return render(<Shown />).container;
};
const stat = (root: Element, name: string) => root.querySelector(`[data-stat="${name}"]`)?.textContent;

test("while frames are turned, the view's latency and the content's age are told apart", () => {
  const hud = show({ turned: true, contentAge: 312, warpMs: 0.42, gpuMs: null });
  expect([stat(hud, "motion-to-photon"), stat(hud, "content-age")]).toEqual(["48", "312"]);
  expect(screen.getByText("view latency")).toBeTruthy();
  expect(screen.getByText("View latency, p95")).toBeTruthy();
  expect(stat(hud, "reprojection-time")).toBe("0.4 ms · –");
  expect(screen.queryByText("motion to photon")).toBeNull();
});

test("of a video, the bit rate that is asked for and the key frames that came are told", () => {
  const hud = show({ video: { bitrate: 4_520_000, keyFrames: 3 } });
  expect([stat(hud, "bitrate"), stat(hud, "key-frames")]).toEqual(["4.5 Mbit/s", "3"]);
  cleanup();
  expect(stat(show(), "bitrate")).toBeUndefined();
});

test("where frames cannot be turned, a word says why", () => {
  session.pictures.reprojection.value = "lost";
  expect(stat(show(), "reprojection-note")).toContain("was lost");
});

test.each([
  [1, "Scene-tuned network"],
  [0, "no model at this size"],
  [null, "no model at this size"],
])("what enhances frames of rung %s is said of each", (profile, said) => {
  session.pictures.enhancement.status.value = { kind: "on", labels: ["", "Scene-tuned network"] };
  const frame = { bytes: 52_000, width: 960, height: 540, profile };
  expect(stat(show({ frame }), "enhancement")).toBe(said);
});

test("shows every figure with its unit", () => {
  const hud = show();
  const shown = [...hud.querySelectorAll("[data-stat]")].map((one) => [one.getAttribute("data-stat"), one.textContent]);
  expect(Object.fromEntries(shown)).toEqual({
    "new-views": "42",
    "motion-to-photon": "48",
    "motion-to-photon-p95": "96 ms",
    "round-trip": "31 ms",
    server: "15 ms",
    "server-parts": "1.0 · 11 · 2.3",
    throughput: "24 Mbit/s",
    frame: "52 kB",
    resolution: "960 × 540",
    profile: "Medium-High",
    requests: "2",
    overtaken: "3 · 4",
    transport: "WebTransport streams",
  });
});

test("a frame that came as WebP is told from a JPEG", () => {
  const frame = { bytes: 40_000, width: 960, height: 540, profile: 1, webp: true };
  expect(stat(show({ frame }), "frame")).toBe("40 kB WebP");
});

test("every figure says what it means where one points at it", () => {
  const hud = show({ turned: true, contentAge: 312, video: { bitrate: 4_520_000, keyFrames: 3 } });
  const explained = [...hud.querySelectorAll("[data-stat]")].map((one) =>
    one.closest("[title]")?.getAttribute("title"),
  );
  expect(explained.length).toBeGreaterThan(15);
  expect(explained.filter((words) => !words)).toEqual([]);
  expect(new Set(explained).size).toBe(explained.length);
});

test("what is not known yet is a dash, not a zero", () => {
  const hud = show(NO_STATS);
  for (const name of ["motion-to-photon", "round-trip", "server", "server-parts", "throughput", "frame", "profile"]) {
    expect(stat(hud, name)).toBe("–");
  }
  expect(stat(hud, "transport")).toBe("not connected");
});

test.each([
  [{ newViewsPerSecond: 0, settled: true, shown: 3 }, "idle"],
  [{ newViewsPerSecond: 0, settled: true, shown: 0 }, "0"],
  [{ newViewsPerSecond: 0, settled: false, shown: 3 }, "0"],
])("a camera that stands still is idle, a server that sends nothing is not: %j", (stats, expected) => {
  expect(stat(show(stats), "new-views")).toBe(expected);
});

test("figures follow the session", async () => {
  const hud = show();
  await act(() => {
    session.pictures.stats.value = { ...STATS, newViewsPerSecond: 12 };
  });
  expect(stat(hud, "new-views")).toBe("12");
});

test("in a cluster it is said which host the frames are from", () => {
  expect(stat(show(), "host")).toBeUndefined();
  session.connected.value = { transport: new FakeTransport(() => 0), fallback: null, host: "east" };
  expect(stat(show(), "host")).toBe("east");
});

test("a fallback says why it is one", () => {
  session.connected.value = {
    transport: new FakeTransport(() => 0),
    fallback: "QUIC did not respond in time",
    host: null,
  };
  expect(stat(show({ transport: "fetch" }), "fallback")).toBe(" – QUIC did not respond in time");
});

test("a server that is the limit is named", () => {
  expect(stat(show(), "server-note")).toBeUndefined();
  expect(stat(show({ serverBound: true }), "server-note")).toBe(
    "The server is slow to draw this scene; your connection is fine.",
  );
});

test("no more than the two most important notes are shown", () => {
  session.pictures.reprojection.value = "slow";
  session.pictures.enhancement.status.value = { kind: "failed", message: "It took 40 ms per frame." };
  show({ serverBound: true });
  expect(screen.getAllByRole("status").map((note) => note.dataset.stat)).toEqual([
    "reprojection-note",
    "enhancement-note",
  ]);
});

test("a server that has fallen silent is named while it is", async () => {
  const hud = show();
  expect(stat(hud, "silence")).toBeUndefined();
  await act(() => {
    session.silent.value = true;
  });
  expect(stat(hud, "silence")).toBe(" – no response, retrying…");
});

test("the measurements can be folded into one line, which is remembered", async () => {
  show();
  await userEvent.click(screen.getByRole("button", { name: "Fewer measurements" }));
  expect(settings.value.hudDetails).toBe(false);
});
