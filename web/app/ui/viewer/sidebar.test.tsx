// @vitest-environment happy-dom
import { cleanup, render, screen, within } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeAll, beforeEach, expect, test, vi } from "vitest";
import { serverConfig } from "#fakes/server";
import { asSession, type FakeSession, fakeSession, fakeSide, fakeStream } from "#fakes/session";
import { turning } from "#viewer/reproject/acceleration";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { NO_STATS } from "#viewer/stateless/stats";
import { config, sceneLadder, settings } from "../../state/app";
import { Sidebar } from "./sidebar";

vi.mock("../chart/plots", () => ({ plotLive: () => () => undefined, plotDistribution: () => () => undefined }));

let session: FakeSession;
const actions = { sidebar: vi.fn(), reset: vi.fn(), hud: vi.fn(), experiment: vi.fn() };

beforeAll(() => import("./panels")); // which takes a busy machine a while

beforeEach(() => {
  turning.value = null;
  vi.clearAllMocks();
  settings.value = DEFAULT_SETTINGS;
  config.value = serverConfig();
  sceneLadder.value = null;
  session = fakeSession();
});

afterEach(cleanup);

const show = async () => {
  render(<Sidebar session={asSession(session)} actions={actions} onSkip={() => undefined} />);
  await screen.findByRole("heading", { name: "Lens" });
};
const section = (name: string) =>
  within(screen.getByRole("heading", { name, level: 3 }).closest("section") as HTMLElement);

test("a controller that adapts shows the rung that it has chosen; a fixed profile is chosen by the person", async () => {
  const user = userEvent.setup();
  session.pictures.stats.value = { ...NO_STATS, frame: { bytes: 1, width: 640, height: 360, profile: 2 } };
  await show();
  const quality = section("Quality");
  expect(quality.getByRole("radio", { name: /Medium-Low/ })).toHaveProperty("checked", true);
  expect(quality.getByText("640 × 360")).toBeTruthy();
  expect(quality.getByRole("group", { name: "Profile" })).toHaveProperty("disabled", true);
  await user.selectOptions(quality.getByRole("combobox", { name: "Adaptation" }), "fixed");
  await user.click(quality.getByRole("radio", { name: /^Low/ }));
  expect(settings.value).toMatchObject({ controller: "fixed", profile: 3 });
  await user.click(quality.getByRole("checkbox", { name: "Sharpen when you stop" }));
  await user.click(quality.getByRole("checkbox", { name: "WebP on slow links" }));
  expect(settings.value).toMatchObject({ refine: false, webp: false });
});

test("a rung that this server's ladder does not have is its last", async () => {
  settings.value = { ...DEFAULT_SETTINGS, controller: "fixed", profile: 9 };
  await show();
  expect(section("Quality").getByRole("radio", { name: /^Low/ })).toHaveProperty("checked", true);
});

test("a rung of a scene's own ladder is named once, with the size of its frames", async () => {
  sceneLadder.value = [{ name: "480×270 q50", width: 480, height: 270, quality: 50, expected_kb: 11.4 }];
  await show();
  expect(section("Quality").getByRole("radio").closest("label")?.textContent).toBe("480×270 q50about 11 kB");
  expect(section("Quality").getAllByRole("radio")).toHaveLength(1);
});

test("how movement is met is chosen by keyboard, and settings that need reprojection wait for it", async () => {
  const user = userEvent.setup();
  await show();
  const panel = section("Reprojection");
  const depth = panel.getByRole("checkbox", { name: "Use depth" });
  const overscan = panel.getByRole("combobox", { name: "Overscan" });
  await user.selectOptions(overscan, "10 %");
  await user.selectOptions(panel.getByRole("combobox", { name: "Prediction" }), "Linear");
  await user.click(depth);
  panel.getByRole("checkbox", { name: "Smooth turning (reprojection)" }).focus();
  await user.keyboard(" ");
  expect(settings.value).toMatchObject({ reprojection: false, prediction: "linear", overscan: 0.1, depth: false });
  expect([depth, overscan].map((field) => (field as HTMLInputElement).disabled)).toEqual([true, true]);
  turning.value = "slow";
  await user.keyboard(" ");
  expect(turning.value, "whoever switches it on insists on it").toBe("forced");
});

test("an overscan that an experiment set is offered, too", async () => {
  settings.value = { ...DEFAULT_SETTINGS, overscan: 0.125 };
  await show();
  expect(section("Reprojection").getByRole("option", { name: "12.5 %" })).toHaveProperty("selected", true);
});

test("a browser that cannot turn frames says so in the panel", async () => {
  session.pictures.reprojection.value = "slow";
  await show();
  expect(section("Reprojection").getByRole("status").textContent).toContain("without the graphics processor");
});

test("a browser that cannot turn the stream's frames says so, beside frames that are turned, too", async () => {
  settings.value = { ...DEFAULT_SETTINGS, mode: "side-by-side" };
  const stream = fakeStream({ kind: "playing" });
  stream.reprojection.value = "unreadable";
  session.right.value = fakeSide("right", stream);
  await show();
  expect(section("Reprojection").getByRole("status").textContent).toContain("WebCodecs");
});

test("the transport is chosen by name", async () => {
  await show();
  await userEvent.selectOptions(screen.getByRole("combobox", { name: "Transport" }), "HTTP fetch");
  expect(settings.value.transport).toBe("fetch");
});

test("the lens is set field by field and reset; numbers that make no lens are put back", async () => {
  const user = userEvent.setup();
  await show();
  const lens = section("Lens");
  const fx = lens.getByRole("spinbutton", { name: /fx/ }) as HTMLInputElement;
  const usual = fx.value;
  const type = async (text: string) => {
    await user.clear(fx);
    await user.type(fx, text);
    await user.tab();
  };
  await type("1500");
  expect(session.rig.intrinsics.value.fx).toBe(1500);
  expect(lens.getByText(/Your values are kept/)).toBeTruthy();
  await type("-3");
  expect(fx.value).toBe("1500");
  await user.click(lens.getByRole("button", { name: "Reset lens" }));
  expect(fx.value).toBe(usual);
  expect(session.rig.lens.value).toEqual({});
});

test("speeds are set, and the camera is reset and the settings closed by their buttons", async () => {
  const user = userEvent.setup();
  await show();
  const turn = screen.getByRole("spinbutton", { name: /Turn/ });
  await user.clear(turn);
  await user.type(turn, "90{Tab}");
  expect(settings.value.turnSpeed).toBe(90);
  const move = screen.getByRole("spinbutton", { name: /Move/ });
  await user.clear(move);
  await user.type(move, "0.5{Tab}");
  expect(session.rig.moveSpeed.value).toBe(0.5);
  await user.click(screen.getByRole("button", { name: "Reset camera" }));
  await user.click(screen.getByRole("button", { name: "Close lab" }));
  expect(actions.reset).toHaveBeenCalledOnce();
  expect(actions.sidebar).toHaveBeenCalledOnce();
});

test.each(["DASH", "WebRTC"])("without a packager the mode %s says how to get one", async (name) => {
  await show();
  session.left.missing.value = `This server does not offer ${name} streams`;
  await userEvent.click(screen.getByRole("radio", { name }));
  expect(settings.value.mode).toBe(name.toLowerCase());
  expect(screen.getByRole("alert").textContent).toContain(`not offer ${name} streams. Run tigas dash`);
  expect(screen.queryByRole("group", { name: "DASH stream" })).toBeNull();
});

test("with a packager its stream is set up by preset, or number by number", async () => {
  const user = userEvent.setup();
  config.value = serverConfig({ dash: "http://dash.test" });
  settings.value = { ...DEFAULT_SETTINGS, mode: "dash" };
  session.left.source.value = fakeStream({ kind: "playing" });
  await show();
  await user.click(screen.getByRole("radio", { name: "Typical" }));
  expect(settings.value.dashPreset).toBe("typical");
  expect(screen.getByText(/Segments of 2 s in chunks of 500 ms, .*dash.js; target latency 1000 ms\./)).toBeTruthy();
  await user.click(screen.getByRole("radio", { name: "60 frames/s" }));
  expect(settings.value.dashFrameRate).toBe(60);
  await user.click(screen.getByRole("radio", { name: "HTTP/3" }));
  expect(settings.value.dashTransport).toBe("h3");
  expect(screen.getByText(/in chunks of 500 ms/)).toBeTruthy(); // the same duration, with more frames
  await user.click(screen.getByRole("radio", { name: "Edge" }));
  expect(screen.getByText(/chunks of one frame, played by a minimal player; target latency 60 ms/)).toBeTruthy();
  await user.click(screen.getByRole("radio", { name: "Custom" }));
  const target = screen.getByRole("spinbutton", { name: /Target/ });
  await user.clear(target);
  await user.type(target, "200.4{Tab}");
  expect(settings.value.dashCustom.target_latency_ms).toBe(200);
  settings.value = { ...settings.value, dashCustom: { ...settings.value.dashCustom, frames_per_chunk: 30 } };
  const segment = screen.getByRole("spinbutton", { name: /Segment/ });
  await user.clear(segment);
  await user.type(segment, "0.5{Tab}");
  expect(settings.value.dashCustom, "no more frames than a segment has").toMatchObject({ frames_per_chunk: 15 });
});

test("any two modes are compared, and shared settings of streams appear once", async () => {
  const user = userEvent.setup();
  config.value = serverConfig({ dash: "http://dash.test" });
  settings.value = { ...DEFAULT_SETTINGS, mode: "side-by-side" };
  session.right.value = fakeSide("right");
  await show();
  expect(screen.queryByRole("radio", { name: "Typical" })).toBeNull();
  await user.click(screen.getByRole("radio", { name: "60 frames/s" }));
  await user.selectOptions(screen.getByRole("combobox", { name: "Left" }), "Video");
  await user.selectOptions(screen.getByRole("combobox", { name: "Right" }), "Local");
  expect(settings.value).toMatchObject({ left: "video", right: "local", dashFrameRate: 60 });
  expect(screen.queryByRole("radio", { name: "60 frames/s" })).toBeNull();
  expect(screen.getByRole("checkbox", { name: "Use depth" })).toHaveProperty("disabled", true);
});

test("both sides are given one resolution or one bit rate, and of a download it is said that it has neither", async () => {
  const user = userEvent.setup();
  config.value = serverConfig({ dash: "http://dash.test" });
  settings.value = { ...DEFAULT_SETTINGS, mode: "side-by-side", right: "local" };
  session.right.value = fakeSide("right");
  await show();
  await user.selectOptions(screen.getByRole("combobox", { name: "Keep the same" }), "Resolution");
  await user.selectOptions(screen.getByRole("combobox", { name: "Profile" }), "640 × 360, Medium-Low");
  expect(settings.value).toMatchObject({ lock: "resolution", lockRung: 2 });
  expect(screen.getByText(/does not apply to downloads/)).toBeTruthy();
  await user.selectOptions(screen.getByRole("combobox", { name: "Keep the same" }), "Bit rate");
  const rate = screen.getByRole("spinbutton", { name: /Limit/ });
  await user.clear(rate);
  await user.type(rate, "1500{Tab}");
  expect(settings.value).toMatchObject({ lock: "bitrate", lockKbps: 1500 });
});

test.each([
  [{}, false],
  [{ shaper: "http://shaper.test" }, true],
])("with the services %j there is a network panel: %s", async (services, offered) => {
  vi.stubGlobal(
    "EventSource",
    class {
      close() {}
    },
  );
  config.value = serverConfig(services);
  await show();
  expect(screen.queryByRole("heading", { name: "Network" }) !== null).toBe(offered);
  cleanup();
});
