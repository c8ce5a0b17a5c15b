// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { afterEach, beforeAll, beforeEach, describe, expect, test, vi } from "vitest";
import { PAPER_LADDER } from "#client/abr/ladder";
import { deferred } from "#client/async/deferred";
import { ApiError } from "#client/http/problem";
import { connect } from "#client/transport/connect";
import { ASK_DIRECTOR_EVERY, CHECK_EVERY } from "#client/transport/ending";
import { RequestProblem } from "#client/transport/transport";
import { FakePage } from "#fakes/page";
import { COURTYARD, serverConfig } from "#fakes/server";
import { type FakeTransport, turn as settle } from "#fakes/transport";
import { fetchConfig, fetchScene, loadScene } from "../state/api";
import { DEFAULT_SETTINGS } from "../state/settings";
import { ViewerState } from "../state/viewer-state";
import { LEFT_AFTER } from "../view/presence";
import { ViewerSession } from "./session";

vi.mock("../state/api");
vi.mock("#client/transport/connect");
const streams = vi.hoisted(() => [] as { readonly options: Record<string, unknown>; disposed: boolean }[]);
vi.mock("../dash/dash-views", () => ({ overDash: (source: unknown) => source }));
vi.mock("../webrtc/webrtc-views", () => ({ overWebRtc: (source: unknown) => source }));
vi.mock("../stream/stream-player", () => ({
  NO_STREAM_STATS: null,
  StreamPlayer: class {
    disposed = false;
    readonly options: Record<string, unknown>;
    readonly phase = signal({ kind: "playing" });
    readonly stats = signal(null);
    constructor(options: Record<string, unknown>) {
      this.options = options;
      streams.push(this);
    }
    presented() {}
    resumed() {}
    tick() {}
    dispose() {
      this.disposed = true;
    }
  },
}));

const downloads = vi.hoisted(() => [] as string[]);
vi.mock("../local/local-player", () => ({
  LocalPlayer: class {
    readonly phase = signal({ kind: "playing" });
    readonly stats = signal(null);
    constructor({ form }: { form: string }) {
      downloads.push(form);
    }
    presented() {}
    resumed() {}
    tick() {}
    dispose() {}
  },
}));

type Div = HTMLDivElement;

const page = new ViewerState();
const { settings, config, ladder, change: changeSettings } = page;

const SERVICES = { dash: "http://dash.test" };
let host: FakePage;
let transports: FakeTransport[];
let session: ViewerSession;

beforeAll(() =>
  Promise.all([import("./comparison"), import("../sources/dash-source"), import("../sources/webrtc-source")]),
);

beforeEach(() => {
  vi.clearAllMocks();
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
  host = new FakePage();
  ({ transports } = host);
  streams.length = 0;
  settings.value = DEFAULT_SETTINGS;
  config.value = null;
  vi.mocked(fetchConfig).mockImplementation(async () => serverConfig(SERVICES));
  vi.mocked(loadScene).mockResolvedValue(COURTYARD);
  vi.mocked(connect).mockImplementation(async () => host.connected());
});

afterEach(() => {
  session.dispose();
  vi.useRealTimers();
  vi.restoreAllMocks();
});

async function visit(): Promise<void> {
  const [element, left, right] = [0, 1, 2].map(() => document.createElement("div")) as [Div, Div, Div];
  const stage = { element, left, right };
  session = new ViewerSession("courtyard", stage, page);
  session.rig.resize(1280, 720);
  await settle();
}

/** Configuration of a cluster, at a host. */
const atHost = (host: string) => ({ ...serverConfig(SERVICES), host });

const drawn = (count: number, options?: { answer: boolean }) => host.frames(count, options);

const phase = () => session.phase.value;
const requests = () => transports.flatMap((transport) => transport.requests).length;

test("connects, loads the scene, and shows it from its start camera", async () => {
  const shown: number[] = [];
  await visit();
  expect(phase()).toEqual({ kind: "playing" });
  expect(session.scene.value?.name).toBe("Courtyard");
  session.onPresented(({ side, at }) => side === "stateless" && shown.push(at));
  await drawn(5);
  expect(transports[0]?.requests[0]?.request).toMatchObject({ scene: "courtyard", position: [0, -2, -8] });
  expect(shown).toEqual([60]); // requested at 20 ms, drawn at 40 ms
  expect(session.receivedBytes).toBe(1000);
});

test("says that the scene loads for as long as it does", async () => {
  vi.mocked(loadScene).mockReturnValue(new Promise(() => undefined));
  await visit();
  expect(phase()).toEqual({ kind: "loading" });
});

test("says how much of the scene is loaded, until it is", async () => {
  let loaded = (_: typeof COURTYARD) => {};
  vi.mocked(loadScene).mockReturnValue(new Promise((resolve) => (loaded = resolve)));
  vi.mocked(fetchScene).mockResolvedValue({ ...COURTYARD, state: "loading", progress: 0.25 });
  await visit();
  await vi.advanceTimersByTimeAsync(600);
  expect(phase()).toEqual({ kind: "loading", progress: 0.25 });
  loaded(COURTYARD);
  await settle();
  await vi.advanceTimersByTimeAsync(2000);
  expect(phase()).toEqual({ kind: "playing" });
  expect(fetchScene).toHaveBeenCalledTimes(2);
});

test.each([
  ["is cut off", new ApiError("The server is not responding.", true)],
  ["no host can answer", new ApiError("No host is up.", false, "tigas:overloaded")],
])("a request for the scene that %s is made again, while the connection lasts", async (_, error) => {
  vi.mocked(loadScene).mockRejectedValue(error);
  await visit();
  expect(phase()).toEqual({ kind: "loading" });
  vi.mocked(loadScene).mockResolvedValue(COURTYARD);
  await vi.advanceTimersByTimeAsync(10_000);
  expect(phase()).toEqual({ kind: "playing" });
});

describe("a scene that can be shown coarsely while it loads", () => {
  const early = { ...COURTYARD, state: "loading" as const };
  const load = () => {
    const loading = deferred<typeof COURTYARD>();
    vi.mocked(loadScene).mockImplementation(async (_, __, { coarse } = {}) => (coarse ? early : loading.promise));
    return loading;
  };

  test("is shown, and the same view is asked for again once it is loaded", async () => {
    const { resolve } = load();
    await visit();
    await drawn(5);
    expect(phase()).toEqual({ kind: "loading" });
    expect(host.requests()).toMatchObject([{ coarse: true, position: [0, -2, -8] }]);
    const { pose } = session.rig;
    resolve({ ...COURTYARD, camera: { position: [1, 1, 1], look_at: [0, 0, 0] } });
    await settle();
    expect(phase()).toEqual({ kind: "playing" });
    await drawn(5);
    expect(session.rig.pose).toBe(pose);
    expect(host.requests().slice(1)).toMatchObject([{ position: [0, -2, -8] }]);
    expect(host.requests()[1]).not.toHaveProperty("coarse");
  });

  test("is shown no more if it cannot be loaded", async () => {
    const { reject } = load();
    await visit();
    await drawn(5);
    reject(new ApiError("The file ends too early.", false));
    await settle();
    expect(phase()).toEqual({ kind: "failed", message: "The file ends too early." });
    session.rig.drive((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
    await drawn(5);
    expect(host.requests()).toHaveLength(1);
  });

  test("is opened as a stream only once it is loaded", async () => {
    const { resolve } = load();
    changeSettings({ mode: "dash" });
    await visit();
    await vi.advanceTimersByTimeAsync(1000); // the viewport has kept its size
    expect(streams).toHaveLength(0);
    resolve(COURTYARD);
    await vi.advanceTimersByTimeAsync(1000);
    expect(streams).toHaveLength(1);
  });
});

test("a scene that cannot be had is said in the server's words, and can be tried again", async () => {
  vi.mocked(loadScene).mockRejectedValue(new ApiError("There is no scene courtyard.", false));
  await visit();
  expect(phase()).toEqual({ kind: "failed", message: "There is no scene courtyard." });
  vi.mocked(loadScene).mockResolvedValue(COURTYARD);
  session.retry();
  await settle();
  expect(phase()).toEqual({ kind: "playing" });
});

test("a scene whose file was replaced is read anew before the next run", async () => {
  await visit();
  await drawn(3);
  const replaced = { ...COURTYARD, file_sha256: "another" };
  vi.mocked(loadScene).mockResolvedValue(replaced);
  session.retry();
  await settle();
  expect(session.scene.value).toEqual(replaced);
});

test("no animation frame for a long time means that the page was hidden: no latency is counted", async () => {
  await visit();
  session.rig.drive((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  await drawn(30);
  host.now += 30_000;
  await drawn(30);
  expect(session.source.value?.stats.value.motionToPhoton?.p95).toBeLessThan(200);
  expect(session.source.value?.stats.value.contentAge).toBeLessThan(200);
});

test("whoever stands still hears that the scene was deleted, and can come back once it is there again", async () => {
  changeSettings({ mode: "side-by-side", left: "stateless", right: "stateless" });
  await visit();
  await drawn(5);
  vi.mocked(fetchConfig).mockImplementation(async () => ({ ...serverConfig(SERVICES), has_scene: false }));
  vi.mocked(loadScene).mockRejectedValue(new ApiError("There is no scene 'courtyard'.", false));
  await vi.advanceTimersByTimeAsync(CHECK_EVERY);
  expect(phase()).toEqual({ kind: "failed", message: "Courtyard was deleted or renamed on the server." });
  const before = requests();
  session.rig.drive((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  await drawn(5);
  expect(requests()).toBe(before);
  session.rig.drive(null);
  session.retry();
  await settle();
  expect(phase()).toEqual({ kind: "failed", message: "There is no scene 'courtyard'." });
  vi.mocked(fetchConfig).mockImplementation(async () => ({ ...serverConfig(SERVICES), has_scene: true }));
  vi.mocked(loadScene).mockResolvedValue(COURTYARD);
  session.retry();
  await settle();
  await drawn(5);
  expect(phase()).toEqual({ kind: "playing" });
  expect(requests()).toBeGreaterThan(before);
});

test("a full server is called full, and the visit begins by itself once there is room", async () => {
  vi.mocked(fetchConfig).mockResolvedValueOnce({ ...serverConfig(SERVICES), retry_after_s: 5 });
  await visit();
  expect(phase()).toEqual({ kind: "full" });
  await vi.advanceTimersByTimeAsync(10_000);
  expect(phase()).toEqual({ kind: "playing" });
});

test("a lost server is announced, and the visit goes on with the same pose when it is back", async () => {
  await visit();
  await drawn(3);
  const { pose } = session.rig;
  transports[0]?.lose("The connection to the server was lost.");
  await settle();
  expect(phase()).toEqual({ kind: "lost", message: "The connection to the server was lost." });
  await drawn(3);
  const before = requests();
  await vi.advanceTimersByTimeAsync(5000);
  expect(phase()).toEqual({ kind: "playing" });
  await drawn(3);
  expect(requests()).toBe(before + 1);
  expect(session.rig.pose).toBe(pose);
});

test("a server that is back and loads the scene again is not called lost, and the scene stays as it was", async () => {
  changeSettings({ mode: "side-by-side", left: "stateless", right: "dash-edge" });
  await visit();
  await vi.advanceTimersByTimeAsync(1000);
  const { promise: loaded, resolve } = deferred<typeof COURTYARD>();
  vi.mocked(loadScene).mockImplementation(async (_, __, { coarse } = {}) =>
    coarse ? { ...COURTYARD, state: "loading" } : loaded,
  );
  transports[0]?.lose("The server was restarted.");
  await vi.advanceTimersByTimeAsync(400);
  expect(phase()).toEqual({ kind: "loading" });
  vi.mocked(fetchScene).mockResolvedValue({ ...COURTYARD, state: "loading", progress: 0.5 });
  await vi.advanceTimersByTimeAsync(600);
  expect(phase()).toEqual({ kind: "loading", progress: 0.5 });
  resolve(COURTYARD);
  await vi.advanceTimersByTimeAsync(1000);
  expect(phase()).toEqual({ kind: "playing" });
  expect(streams.map(({ disposed }) => disposed)).toEqual([false]);
});

test("profiles count in the scene's own ladder for as long as the visit lasts, also after the server was started with another", async () => {
  const own = [{ name: "480×270 q50", width: 480, height: 270, quality: 50, expected_kb: 11, psnr_db: 33 }];
  vi.mocked(loadScene).mockResolvedValue({ ...COURTYARD, ladder: own });
  await visit();
  expect(ladder.value).toEqual(own);
  vi.mocked(loadScene).mockResolvedValue(COURTYARD);
  transports[0]?.lose("The server was restarted.");
  await settle();
  await vi.advanceTimersByTimeAsync(5000);
  expect(phase()).toEqual({ kind: "playing" });
  expect(ladder.value).toEqual(PAPER_LADDER);
  vi.mocked(loadScene).mockResolvedValue({ ...COURTYARD, ladder: own });
  transports[1]?.lose("The server was restarted.");
  await settle();
  await vi.advanceTimersByTimeAsync(5000);
  expect(ladder.value).toEqual(own);
  session.dispose();
  expect(ladder.value).toEqual(PAPER_LADDER);
});

test("a rung that is refused because the ladder has become shorter is asked for no longer", async () => {
  changeSettings({ controller: "fixed", profile: 3 });
  await visit();
  await drawn(3);
  const own = [{ name: "480×270 q50", width: 480, height: 270, quality: 50, expected_kb: 11, psnr_db: 33 }];
  vi.mocked(loadScene).mockResolvedValue({ ...COURTYARD, ladder: own });
  session.rig.drive((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  const asked = transports[0]?.requests ?? [];
  const before = asked.length;
  const refusal = { type: "tigas:invalid-request", title: "", status: 400, detail: "The ladder has rungs 0 to 0." };
  for (let i = 0; i < 20; i++) {
    for (const { fail } of asked.slice(before).filter(({ request }) => request.profile === 3)) {
      fail(new RequestProblem(refusal));
    }
    await drawn(1, { answer: false });
  }
  expect(vi.mocked(loadScene).mock.calls.filter(([, , options]) => !options?.coarse)).toHaveLength(2);
  expect(ladder.value).toEqual(own);
  await drawn(3);
  expect(asked.at(-1)?.request.profile).toBe(0);
  expect(session.source.value?.phase.value).toEqual({ kind: "playing" });
});

test("another transport is connected at once, and the former closed", async () => {
  await visit();
  changeSettings({ transport: "fetch" });
  await settle();
  expect(vi.mocked(connect).mock.calls.map(([, choice]) => choice)).toEqual(["auto", "fetch"]);
  expect(transports.map(({ closed }) => closed)).toEqual([true, false]);
});

test("the DASH mode asks for no JPEGs; the other modes do", async () => {
  await visit();
  changeSettings({ mode: "dash" });
  await drawn(5);
  expect(requests()).toBe(0);
  changeSettings({ mode: "side-by-side" });
  await drawn(5);
  expect(requests()).toBe(1);
});

test("two modes that ask for each view are two clients of the server, and leave nothing behind", async () => {
  changeSettings({ left: "stateless", right: "stateless" });
  await visit();
  await drawn(3);
  const pane = session.stage.right;
  expect(pane.childElementCount).toBe(0);
  changeSettings({ mode: "side-by-side" });
  await settle();
  expect(session.comparison.value?.sides).toEqual([session.left, session.right.value]);
  await drawn(5);
  expect(transports).toHaveLength(2);
  expect(transports.map(({ requests }) => requests.length > 0)).toEqual([true, true]);
  expect([...pane.children].map(({ tagName }) => tagName)).toEqual(["CANVAS"]);
  transports[1]?.lose("The right one broke.");
  await settle();
  expect(session.rightConnection.value).toMatchObject({ status: "lost" });
  expect(phase()).toEqual({ kind: "playing" });
  const received = session.receivedBytes;
  changeSettings({ mode: "stateless" });
  await vi.advanceTimersByTimeAsync(5000);
  expect(transports.map(({ closed }) => closed)).toEqual([false, true]);
  expect([pane.childElementCount, session.receivedBytes, session.right.value]).toEqual([0, received, null]);
  expect(session.comparison.value).toBeNull();
});

test("a stream is opened where the mode has one, and again when its settings change", async () => {
  await visit();
  await vi.advanceTimersByTimeAsync(1000); // the viewport has kept its size
  expect(streams).toHaveLength(0);
  changeSettings({ mode: "side-by-side" });
  await settle();
  expect(streams).toHaveLength(1);
  expect(streams[0]?.options).toMatchObject({
    side: "dash",
    open: { base: "http://dash.test", scene: "courtyard" },
  });
  config.value = serverConfig(SERVICES); // it is read again and again
  expect(streams).toHaveLength(1);
  changeSettings({ dashPreset: "typical" }); // of the mode `dash`
  expect(streams).toHaveLength(1);
  changeSettings({ right: "dash-typical" });
  expect(streams.map(({ disposed }) => disposed)).toEqual([true, false]);
  session.rig.resize(640, 360);
  await vi.advanceTimersByTimeAsync(300);
  session.rig.resize(660, 360);
  await vi.advanceTimersByTimeAsync(300);
  expect(streams).toHaveLength(2);
  await vi.advanceTimersByTimeAsync(200);
  expect(streams).toHaveLength(3);
  changeSettings({ mode: "stateless" });
  expect(streams.map(({ disposed }) => disposed)).toEqual([true, true, true]);
});

test("another form of the scene is another download", async () => {
  const forms = ["compressed", "streamed"] as const;
  vi.mocked(loadScene).mockResolvedValue({ ...COURTYARD, downloads: forms.map((form) => ({ form, bytes: 9 })) });
  await visit();
  changeSettings({ mode: "local", localForm: "compressed" });
  await vi.waitFor(() => expect(downloads).toEqual(["compressed"]));
  changeSettings({ hud: false });
  changeSettings({ localForm: "streamed" });
  await vi.waitFor(() => expect(downloads).toEqual(["compressed", "streamed"]));
});

test("where the browser gives a video's pictures away to nobody, a word says so, and the stream has no margins", async () => {
  await visit(); // this DOM has no VideoFrame
  await vi.advanceTimersByTimeAsync(1000);
  changeSettings({ mode: "dash" });
  await settle();
  expect(session.source.value?.reprojection.value).toBe("unreadable");
  await vi.advanceTimersByTimeAsync(1000); // the viewport has kept its size
  expect(streams.at(-1)?.options.overscan).toBeNull();
});

/** The user switches to another tab, or back. */
async function hide(hidden: boolean, after = 0): Promise<void> {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
  await vi.advanceTimersByTimeAsync(after);
}

test("a page that nobody has seen for a while holds no connection, stream or decoder, and asks for nothing", async () => {
  changeSettings({ mode: "side-by-side", left: "stateless", right: "dash-tuned" });
  await visit();
  await vi.advanceTimersByTimeAsync(1000); // the viewport has kept its size
  await drawn(5);
  await hide(true, LEFT_AFTER - 1000);
  await hide(false); // back in time
  await drawn(5);
  expect([transports.map(({ closed }) => closed), streams.map(({ disposed }) => disposed)]).toEqual([[false], [false]]);
  await hide(true, LEFT_AFTER);
  expect([transports.map(({ closed }) => closed), streams.map(({ disposed }) => disposed)]).toEqual([[true], [true]]);
  expect(session.sources.value).toEqual([]);
  const asked = vi.mocked(fetchConfig).mock.calls.length;
  await vi.advanceTimersByTimeAsync(60_000);
  expect(vi.mocked(fetchConfig).mock.calls).toHaveLength(asked);
  const shown: number[] = [];
  session.onPresented(({ pose }) => shown.push(pose));
  await hide(false, 1000);
  host.now += 120_000;
  await drawn(20);
  expect(phase()).toEqual({ kind: "playing" });
  expect([transports.map(({ closed }) => closed), streams.map(({ disposed }) => disposed)]).toEqual([
    [true, false],
    [true, false],
  ]);
  expect(shown.length).toBeGreaterThan(0);
  expect(session.source.value?.stats.value.contentAge).toBeLessThan(200);
});

test("a page that is left ends its stream, and one that is shown again as it was opens another", async () => {
  await visit();
  await vi.advanceTimersByTimeAsync(1000);
  changeSettings({ mode: "dash" });
  await vi.advanceTimersByTimeAsync(1000);
  dispatchEvent(new Event("pagehide"));
  expect(streams.map(({ disposed }) => disposed)).toEqual([true]);
  dispatchEvent(new Event("pageshow"));
  await vi.advanceTimersByTimeAsync(1000);
  expect(streams.map(({ disposed }) => disposed)).toEqual([true, false]);
});

test("a device that is online again tries to connect at once", async () => {
  await visit();
  vi.stubGlobal("navigator", { ...navigator, onLine: false });
  dispatchEvent(new Event("offline"));
  vi.mocked(fetchConfig).mockRejectedValue(new ApiError("The server is not responding.", true));
  transports[0]?.lose("The connection broke.");
  await settle();
  expect(phase().kind).toBe("lost");
  vi.mocked(fetchConfig).mockImplementation(async () => serverConfig(SERVICES));
  vi.stubGlobal("navigator", { ...navigator, onLine: true });
  dispatchEvent(new Event("online"));
  await settle();
  expect(phase()).toEqual({ kind: "playing" });
});

test("a visit that ends leaves nothing running", async () => {
  await visit();
  await vi.advanceTimersByTimeAsync(1000);
  changeSettings({ mode: "side-by-side" });
  await settle();
  session.dispose();
  await settle();
  expect(host.animationFrames.size).toBe(0);
  expect(transports.map(({ closed }) => closed)).toEqual([true]);
  expect(streams.map(({ disposed }) => disposed)).toEqual([true]);
});

test("another host of a cluster takes over once it has the scene, and the old picture stays until then", async () => {
  vi.mocked(connect).mockImplementation(async ({ host: name = null }) => host.connected(name));
  vi.mocked(fetchConfig).mockImplementation(async () => atHost("east"));
  await visit();
  await drawn(5);
  expect(vi.mocked(fetchConfig).mock.lastCall?.[1]).toEqual({ scene: "courtyard" });
  expect(vi.mocked(loadScene).mock.lastCall?.[2]).toMatchObject({ host: "east", server: "" });

  const { promise: loaded, resolve } = deferred<typeof COURTYARD>();
  vi.mocked(loadScene).mockReturnValue(loaded);
  vi.mocked(fetchConfig).mockImplementation(async () => atHost("west"));
  await vi.advanceTimersByTimeAsync(ASK_DIRECTOR_EVERY);
  expect(vi.mocked(fetchConfig).mock.lastCall?.[1]).toEqual({ scene: "courtyard", at: "east" });
  expect(vi.mocked(loadScene).mock.lastCall?.[2]).toMatchObject({ host: "west", server: "" });
  expect(transports.map(({ closed }) => closed)).toEqual([false]);
  expect([phase(), session.connected.value?.host]).toEqual([{ kind: "playing" }, "east"]);

  resolve(COURTYARD);
  await vi.advanceTimersByTimeAsync(0);
  expect(transports.map(({ closed }) => closed)).toEqual([true, false]);
  expect([phase(), session.connected.value?.host]).toEqual([{ kind: "playing" }, "west"]);
  await drawn(3);
  expect(transports[1]?.requests.length).toBeGreaterThan(0);
});

test("another host that could not load the scene at first loads it, and the page says so", async () => {
  vi.mocked(connect).mockImplementation(async ({ host: name = null }) => host.connected(name));
  vi.mocked(fetchConfig).mockImplementation(async () => atHost("east"));
  await visit();
  vi.mocked(loadScene).mockRejectedValue(new ApiError("The server is not responding.", true));
  vi.mocked(fetchConfig).mockImplementation(async () => atHost("west"));
  await vi.advanceTimersByTimeAsync(ASK_DIRECTOR_EVERY);
  expect([phase(), session.connected.value?.host]).toEqual([{ kind: "loading" }, "west"]);
  vi.mocked(loadScene).mockResolvedValue(COURTYARD);
  await vi.advanceTimersByTimeAsync(10_000);
  expect(phase()).toEqual({ kind: "playing" });
});
