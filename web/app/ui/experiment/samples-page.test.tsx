// @vitest-environment happy-dom
import { cleanup, render, screen, within } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Materialisation, SampleCounts, SampleRow } from "#client/wire/store";
import { serverConfig } from "#fakes/server";
import { fetchConfig, fetchScenes } from "#viewer/state/api";
import { config } from "../../state/app";
import { SamplesPage } from "./samples-page";

vi.mock("#viewer/state/api");

const SAMPLE: SampleRow = {
  seq: 30,
  at: 500,
  rung: 2,
  bytes: 20_000,
  width: 640,
  height: 360,
  restore: "off",
  upscale: "scene",
  enhance_ms: 4.25,
  original: "000030.jpg",
  enhanced: "000030.enhanced.webp",
  truth: "000030.truth.png",
  replayed: null,
  identical: true,
  problem: null,
};
const OTHER: SampleRow = {
  ...SAMPLE,
  seq: 60,
  at: 1000,
  enhanced: null,
  upscale: "off",
  enhance_ms: null,
  truth: null,
  identical: null,
};
const IDLE: Materialisation = { state: "idle", done: 1, total: 2, problem: null };
const run = (folder: string, samples: SampleCounts | null) => ({ folder, samples });

/** The store's answers, by method and path. */
let answers: Record<string, unknown>;
let asked: string[];

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setInterval", "clearInterval"] });
  config.value = serverConfig({ store: "http://store.test/" });
  vi.mocked(fetchConfig).mockImplementation(async () => config.value ?? serverConfig());
  vi.mocked(fetchScenes).mockResolvedValue([]);
  answers = {
    "GET ": {
      name: "Bus",
      runs: [
        run("old", null),
        run("first", { samples: 2, identical: 1, different: 0, missing: 1 }),
        run("second", { samples: 1, identical: 0, different: 1, missing: 0 }),
      ],
    },
    "GET /materialise": IDLE,
    "GET /runs/first/samples": { samples: [SAMPLE, OTHER], problem: null },
    "GET /runs/second/samples": { samples: [{ ...SAMPLE, identical: false, replayed: "x" }], problem: null },
  };
  asked = [];
  vi.stubGlobal("fetch", async (url: string, { method = "GET" }: RequestInit) => {
    const what = `${method} ${url.replace("http://store.test/experiments/my%20bus", "")}`;
    asked.push(what);
    if (/\.(jpg|png|webp)$/.test(what)) return new Response(new Blob([what]));
    const answer = answers[what];
    if (answer === undefined) throw new TypeError("refused");
    return answer instanceof Response ? answer : Response.json(answer);
  });
});

afterEach(() => {
  cleanup();
  vi.useRealTimers();
});

const options = (select: HTMLElement) => within(select).getAllByRole("option");
const views = (name: string) => options(screen.getByRole("combobox", { name })).map((option) => option.textContent);

test("runs with samples are listed, and the first one's are shown", async () => {
  render(<SamplesPage id="my bus" />);
  expect(await screen.findByRole("heading", { name: "Bus" })).toBeTruthy();
  expect(screen.queryByText("old")).toBeNull();
  const cells = within(screen.getByRole("row", { name: /first/ })).getAllByRole("cell");
  expect(cells.map((cell) => cell.textContent)).toEqual(["2", "1", "0", "1"]);
  expect(await screen.findByText("20.0 kB, rung 2, scene, enhanced in 4.3 ms")).toBeTruthy();
  expect(views("Right")).toEqual([
    "Received",
    "Enhanced",
    "Ground truth",
    "Received, difference × 4",
    "Enhanced, difference × 4",
  ]);
  await vi.waitFor(() => expect(screen.getAllByAltText("Ground truth")).toHaveLength(2));
});

test("a sample without ground truth says so, and is compared with nothing", async () => {
  render(<SamplesPage id="my bus" />);
  await userEvent.click(await screen.findByRole("button", { name: "Next" }));
  expect(await screen.findByText("Its ground truth has not been rendered yet.")).toBeTruthy();
  expect(views("Left")).toEqual(["Received"]);
  expect(screen.getByRole<HTMLButtonElement>("button", { name: "Next" }).disabled).toBe(true);
});

test("a renderer that answered differently is said, and what it sends now can be seen", async () => {
  render(<SamplesPage id="my bus" />);
  await userEvent.click(await screen.findByRole("radio", { name: "second" }));
  expect(await screen.findByText(/gave a different frame/)).toBeTruthy();
  expect(views("Left")).toContain("Re-rendered");
});

test("rendering is begun, watched and stopped, and the table follows", async () => {
  render(<SamplesPage id="my bus" />);
  answers["POST /materialise"] = { ...IDLE, state: "running" };
  await userEvent.click(await screen.findByRole("button", { name: "Render ground truth" }));
  expect((await screen.findByRole("progressbar")).getAttribute("value")).toBe("1");
  answers["GET /materialise"] = { ...IDLE, state: "running", done: 2 };
  answers["GET "] = { name: "Bus", runs: [run("first", { samples: 2, identical: 2, different: 0, missing: 0 })] };
  answers["GET /runs/first/samples"] = { samples: [SAMPLE], problem: null };
  const everySecond = async () => {
    await vi.advanceTimersByTimeAsync(1000);
    expect(screen.getByText("2 of 2")).toBeTruthy();
  };
  await vi.waitFor(everySecond, 10_000); // the page may not have sent its request yet
  await vi.waitFor(() => expect(within(screen.getByRole("row", { name: /first/ })).getAllByText("2")).toHaveLength(2));
  await vi.waitFor(() => expect(options(screen.getByRole("combobox", { name: "Sample" }))).toHaveLength(1));
  answers["DELETE /materialise"] = answers["GET /materialise"] = { ...IDLE, done: 2 };
  await userEvent.click(screen.getByRole("button", { name: "Stop" }));
  expect(await screen.findByText("2 of 2 have ground truth")).toBeTruthy();
  await vi.advanceTimersByTimeAsync(1000); // the earlier request is answered
  asked = [];
  await vi.advanceTimersByTimeAsync(5000);
  expect(asked).toEqual([]);
});

test("what went wrong is said", async () => {
  answers["POST /materialise"] = { ...IDLE, problem: "The render service does not answer." };
  render(<SamplesPage id="my bus" />);
  await userEvent.click(await screen.findByRole("button", { name: "Render ground truth" }));
  expect((await screen.findByRole("alert")).textContent).toBe("The render service does not answer.");
  const busy = { type: "tigas:experiment-in-use", title: "", status: 409, detail: "A command is at work." };
  answers["POST /materialise"] = Response.json(busy, { status: 409 });
  await userEvent.click(screen.getByRole("button", { name: "Render ground truth" }));
  await vi.waitFor(() => expect(screen.getByRole("alert").textContent).toBe("A command is at work."));
});

test("a store that is away is said", async () => {
  answers = {};
  render(<SamplesPage id="my bus" />);
  expect((await screen.findByRole("alert")).textContent).toContain("The store at http://store.test");
});
