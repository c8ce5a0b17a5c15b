// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { cleanup, render, screen } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { useState } from "preact/hooks";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Draft } from "../../experiment/draft";
import type { Runner } from "../../experiment/runner";
import { MovementError, type MovementTrace } from "../../movement/movement";
import { addFile, movements } from "../../movement/movement-deck";
import { fetchMovement, listMovements } from "../../movement/stored-movements";
import type { Shaper } from "../../network/shaper";
import { config, settings } from "../../state/app";
import { serverConfig } from "../../state/fake-server";
import { DEFAULT_SETTINGS } from "../../state/settings";
import { asSession, fakeSession } from "../../viewer/fake-session";
import { ExperimentDialog } from "./experiment-dialog";
import { ExperimentForm, type ExperimentSetup } from "./experiment-form";

vi.mock("../../movement/stored-movements");

const WALK: MovementTrace = {
  anchor: "scene",
  unit: "scene",
  comments: new Map(),
  points: [{ t_ms: 0, position: [1, 2, 3], quaternion: [0, 0, 0, 1] }],
  duration: 4000,
};
const DRAFT: Draft = {
  name: "Courtyard",
  movement: null,
  trace: null,
  rtt: "",
  modes: ["stateless"],
  profiles: ["latency", "budget"],
  frameRate: null,
  restore: "off",
  upscale: "off",
  reprojection: false,
  prediction: "off",
  overscan: "auto",
  depth: true,
  surround: true,
  segments: "1",
  repeats: "2",
  duration: "20",
  seed: "1",
  stride: "0",
  locked: true,
  exportAtEnd: false,
};
const onStart = vi.fn<(setup: ExperimentSetup) => void>();

beforeEach(() => {
  vi.clearAllMocks();
  movements.value = [];
  settings.value = DEFAULT_SETTINGS;
  config.value = serverConfig();
  vi.mocked(listMovements).mockResolvedValue([
    { name: "stroll", duration_ms: 60_000, anchor: "start", description: "" },
  ]);
  vi.mocked(fetchMovement).mockResolvedValue({ name: "stroll", origin: "store", trace: WALK });
});

afterEach(cleanup);

const SHAPER = {
  traces: signal([{ name: "bus", uploaded: false, mean_down_kbps: 8000 }]),
  connectionError: signal(null),
  status: signal(null),
} as unknown as Shaper;

function Filled({ shaper = null, store }: { readonly shaper?: Shaper | null; readonly store?: string | undefined }) {
  const [draft, setDraft] = useState(DRAFT);
  return (
    <ExperimentForm
      session={asSession(fakeSession())}
      shaper={shaper}
      store={store}
      draft={draft}
      onDraft={setDraft}
      onStart={onStart}
    />
  );
}

const start = () => userEvent.click(screen.getByRole("button", { name: "Start" }));
const problems = () => [...screen.getByRole("alert").children].map(({ textContent }) => textContent);

test("without a movement nothing starts; what is missing is said until something is changed", async () => {
  render(<Filled />);
  await userEvent.clear(screen.getByRole("textbox", { name: "Name" }));
  await start();
  expect(problems()).toEqual(["The experiment needs a name.", "Choose a movement."]);
  expect(onStart).not.toHaveBeenCalled();
  await userEvent.type(screen.getByRole("textbox", { name: "Name" }), "Again");
  expect(problems()).toEqual([]);
});

test("the first movement of the store is chosen, and starts an experiment of what was filled in", async () => {
  render(<Filled store="http://store.test" />);
  await screen.findByRole("option", { name: "stroll · 1:00", selected: true });
  await userEvent.click(screen.getByRole("checkbox", { name: "LoL+" }));
  await userEvent.click(screen.getByRole("checkbox", { name: "Budget" }));
  await userEvent.click(screen.getByRole("checkbox", { name: /Save all files/ }));
  await userEvent.type(screen.getByRole("textbox", { name: "Seed" }), "2");
  await start();
  await vi.waitFor(() => expect(onStart).toHaveBeenCalledOnce());
  expect(onStart.mock.calls[0]?.[0]).toMatchObject({
    plan: {
      name: "Courtyard",
      scene: "courtyard",
      movement: "stroll",
      modes: ["stateless"],
      profiles: ["latency", "lol+"],
      repeats: 2,
      seed: 12,
      shuffled: true,
      duration_s: 20,
    },
    points: [{ t_ms: 0, position: [1, 2, 3] }],
    locked: true,
    exportAtEnd: true,
  });
});

test("the frame rate can be chosen where DASH is measured", async () => {
  addFile("walk.csv", WALK);
  config.value = serverConfig({ dash: "http://dash.test" });
  render(<Filled />);
  const rate = screen.getByRole<HTMLSelectElement>("combobox", { name: /DASH frame rate/ });
  expect(rate.disabled).toBe(true);
  await userEvent.click(screen.getByRole("checkbox", { name: "DASH, edge" }));
  await userEvent.selectOptions(rate, "60 /s");
  await userEvent.selectOptions(screen.getByRole("combobox", { name: /Movement/ }), "walk.csv · 0:04");
  await start();
  await vi.waitFor(() => expect(onStart).toHaveBeenCalledOnce());
  expect(onStart.mock.calls[0]?.[0].plan.dash_frame_rate).toBe(60);
});

test("how movement is met can be chosen, and what needs reprojection waits for it", async () => {
  addFile("walk.csv", WALK);
  render(<Filled />);
  const overscan = screen.getByRole<HTMLSelectElement>("combobox", { name: "Overscan" });
  const [depth, surround] = ["Depth, stateless", "Surround, stateless and video"].map((name) =>
    screen.getByRole<HTMLInputElement>("checkbox", { name }),
  );
  expect([overscan, depth, surround].map((field) => field?.disabled)).toEqual([true, true, true]);
  await userEvent.click(screen.getByRole("checkbox", { name: "Reprojection" }));
  await userEvent.selectOptions(screen.getByRole("combobox", { name: "Prediction" }), "Linear");
  await userEvent.selectOptions(overscan, "15 %");
  await userEvent.click(depth as HTMLElement);
  await userEvent.selectOptions(screen.getByRole("combobox", { name: /Movement/ }), "walk.csv · 0:04");
  await start();
  await vi.waitFor(() => expect(onStart).toHaveBeenCalledOnce());
  expect(onStart.mock.calls[0]?.[0].plan).toMatchObject({
    reprojection: true,
    prediction: "linear",
    overscan: 0.15,
    depth: false,
    surround: true,
  });
});

test("models can be chosen where the browser has WebGPU", async () => {
  addFile("walk.csv", WALK);
  vi.stubGlobal("isSecureContext", true);
  const choice = () => screen.getByRole<HTMLSelectElement>("combobox", { name: /Upscale/ });
  render(<Filled />);
  expect(choice().disabled).toBe(true);
  expect(screen.getByText("This browser has no WebGPU.")).toBeTruthy();
  cleanup();
  vi.stubGlobal("navigator", Object.assign(Object.create(navigator), { gpu: {} }));
  render(<Filled />);
  await userEvent.selectOptions(choice(), "Bicubic");
  await userEvent.selectOptions(screen.getByRole("combobox", { name: /Movement/ }), "walk.csv · 0:04");
  await start();
  await vi.waitFor(() => expect(onStart).toHaveBeenCalledOnce());
  expect(onStart.mock.calls[0]?.[0].plan).toMatchObject({ restore: "off", upscale: "bicubic" });
  vi.unstubAllGlobals();
});

test("a file of this visit is offered, and a movement that cannot be had is said", async () => {
  addFile("walk.csv", WALK);
  vi.mocked(fetchMovement).mockRejectedValue(new MovementError("The store does not answer."));
  render(<Filled store="http://store.test" />);
  const movement = screen.getByRole("combobox", { name: /Movement/ });
  await userEvent.selectOptions(movement, await screen.findByRole("option", { name: "stroll · 1:00" }));
  await start();
  expect(await screen.findByText("The store does not answer.")).toBeTruthy();
  await userEvent.selectOptions(movement, "walk.csv · 0:04");
  await start();
  await vi.waitFor(() => expect(onStart).toHaveBeenCalledOnce());
  expect(onStart.mock.calls[0]?.[0].plan.movement).toBe("walk.csv");
});

test("a trace of the shaper's may have another round trip; the link as it is has its own", async () => {
  addFile("walk.csv", WALK);
  render(<Filled shaper={SHAPER} />);
  await userEvent.selectOptions(screen.getByRole("combobox", { name: /Movement/ }), "walk.csv · 0:04");
  const trip = screen.getByRole("textbox", { name: /Round trip/ });
  expect(trip).toHaveProperty("disabled", true);
  await userEvent.selectOptions(screen.getByRole("combobox", { name: /Network/ }), "bus · 8 Mbit/s");
  await userEvent.type(trip, "80");
  await start();
  await vi.waitFor(() => expect(onStart).toHaveBeenCalledOnce());
  expect(onStart.mock.calls[0]?.[0].plan.network).toEqual({ link: null, trace: "bus", rtt_ms: 80 });
});

test("a shaper that has not told of its link cannot be used as it is", async () => {
  addFile("walk.csv", WALK);
  render(<Filled shaper={SHAPER} />);
  await userEvent.selectOptions(screen.getByRole("combobox", { name: /Movement/ }), "walk.csv · 0:04");
  await start();
  expect(problems()).toEqual(["The shaper has not reported its link yet."]);
});

test("says how many runs it is and how long they take, and where they will be", async () => {
  render(<Filled />);
  const estimate = document.querySelector("[data-experiment=estimate]");
  expect(estimate?.textContent).toBe(
    "4 runs, about 1:52 min. There is no store: the results stay in this page until you save them.",
  );
  const runs = screen.getByRole("textbox", { name: "Runs of each" });
  await userEvent.clear(runs);
  expect(estimate?.textContent).not.toContain("runs, about");
  await userEvent.type(runs, "1");
  expect(estimate?.textContent).toContain("2 runs, about 0:56 min.");
});

test.each([
  [{}, true],
  [{ dash: "http://dash.test" }, false],
])("with the services %j the modes with DASH are disabled: %s", (services, disabled) => {
  config.value = serverConfig(services);
  render(<Filled />);
  expect(screen.getByRole("checkbox", { name: "DASH, tuned" })).toHaveProperty("disabled", disabled);
});

test("the name is the scene's, also if the scene comes after the dialog was opened", async () => {
  const session = fakeSession();
  const scene = session.scene.value;
  session.scene.value = null;
  render(
    <ExperimentDialog session={asSession(session)} runner={{} as Runner} open={signal(true)} locked={signal(false)} />,
  );
  const name = await screen.findByRole<HTMLInputElement>("textbox", { name: "Name" });
  expect(name.value).toBe("");
  session.scene.value = scene;
  await vi.waitFor(() => expect(name.value).toBe(scene?.name));
  await userEvent.clear(name);
  expect(name.value).toBe("");
});
