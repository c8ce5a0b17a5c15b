// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { cleanup, render, screen, within } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { Experiment } from "../../experiment/experiment";
import type { PlannedRun } from "../../experiment/plan";
import type { RunResult } from "../../experiment/results";
import { StoreApi } from "../../experiment/store-api";
import { config } from "../../state/app";
import { serverConfig } from "../../state/fake-server";
import type { RunUpload } from "../../wire/store";
import { ExperimentResults } from "./experiment-results";

vi.mock("./experiment-plot", () => ({ plotResults: () => () => undefined }));

const run = (profile: PlannedRun["profile"], mode: PlannedRun["mode"] = "stateless") =>
  ({ mode, profile, repeat: 0 }) as PlannedRun;
const FIGURES = {
  p50: 48.4,
  p90: 80.4,
  p95: 96.2,
  p99: 120.2,
  viewP50: 16.4,
  viewP95: 33.2,
  interactive: 0.97,
  interactiveFrameLess: 0.93,
  interactiveFrameMore: 0.99,
  contentAge: 61.7,
  newViewsPerSecond: 41.26,
  meanHeight: 540,
  switches: 3,
  received: 12_340_000,
};
const COMPLETE: RunResult = {
  run: run("budget"),
  status: "complete",
  problem: null,
  figures: FIGURES,
  inputLatencies: [{ at: 0, latency: 40 }],
  hidden: false,
  unstored: null,
  samples: null,
  samplesProblem: null,
};
const FAILED: RunResult = {
  ...COMPLETE,
  status: "failed",
  problem: "No frame came during the run.",
  figures: null,
  inputLatencies: [],
};
const STORE = new StoreApi("http://store.test");
const store = vi.fn(async () => undefined);
const onExport = vi.fn();
const onAgain = vi.fn();

beforeEach(() => {
  vi.clearAllMocks();
  config.value = serverConfig();
});

afterEach(cleanup);

function show(
  results: readonly RunResult[],
  { id = null, ...more }: { id?: string | null } & Partial<Omit<Experiment, "id">> = {},
) {
  const experiment = {
    results: signal(results),
    id: signal(id),
    notice: signal(null),
    progress: signal(null),
    unsaved: signal(results.some(({ unstored }) => unstored !== null)),
    cancelled: false,
    store,
    ...more,
  };
  render(
    <ExperimentResults
      experiment={experiment as unknown as Experiment}
      store={id === null ? null : STORE}
      onExport={onExport}
      onAgain={onAgain}
    />,
  );
}

const cells = (row: string | RegExp) =>
  within(screen.getByRole("row", { name: row }))
    .getAllByRole("cell")
    .map(({ textContent }) => textContent);

test("each controller and mode has a row with the means of its complete runs", () => {
  const faster = { ...COMPLETE, figures: { ...FIGURES, p50: 28.4 } };
  show([COMPLETE, { ...COMPLETE, run: run(1) }, faster, { ...FAILED, run: run("budget", "dash-tuned") }]);
  expect(cells(/^Budget/)).toEqual([
    "2",
    "16",
    "33",
    "38",
    "80",
    "96",
    "120",
    "97",
    "93",
    "99",
    "62",
    "41.3",
    "540",
    "3.0",
    "12.3",
  ]);
  expect(cells(/^Fixed: Medium-High/)[0]).toBe("1");
  expect(cells(/^DASH, tuned/)).toEqual(["0 of 1", ...Array(14).fill("–")]);
});

test("what must be known of single runs is said", () => {
  show([{ ...COMPLETE, hidden: true }, FAILED, { ...COMPLETE, saturatedShare: 0.42 }]);
  expect(screen.getAllByRole("listitem").map(({ textContent }) => textContent)).toEqual([
    "Run 1, Budget: The page was hidden, so that the browser may have held frames back.",
    "Run 2, Budget: No frame came during the run.",
    "Run 3, Budget: The machine was out of processor time for 42 % of the run, so the latencies include its delays.",
  ]);
});

test("without a store the runs are saved as one file, and are lost otherwise", async () => {
  show([{ ...COMPLETE, unstored: {} as RunUpload }]);
  await userEvent.click(screen.getByRole("button", { name: "Save as JSON" }));
  expect(onExport).toHaveBeenCalledOnce();
  await userEvent.click(screen.getByRole("button", { name: "Discard and start over" }));
  expect(onAgain).toHaveBeenCalledOnce();
  expect(screen.queryByRole("link", { name: "Report" })).toBeNull();
  expect(screen.queryByRole("button", { name: "Store again" })).toBeNull();
});

test("with a store there is a report, and what the store refused is offered again", async () => {
  show([COMPLETE, { ...COMPLETE, unstored: {} as RunUpload }], { id: "e 1" });
  const report = screen.getByRole("link", { name: "Report" });
  expect(report.getAttribute("href")).toBe("http://store.test/experiments/e%201/report");
  await userEvent.click(screen.getByRole("button", { name: "Store again" }));
  expect(store).toHaveBeenCalledOnce();
  expect(screen.getByRole("button", { name: "Save as ZIP" })).toBeTruthy();
});

test("while runs are still made nothing is saved or discarded", () => {
  show([COMPLETE], { progress: signal({}) as unknown as Experiment["progress"] });
  expect(screen.queryByRole("button")).toBeNull();
});

test("a cancelled experiment, and one that no store keeps, say so", () => {
  show([COMPLETE], { cancelled: true, notice: signal("The store does not answer. The results stay in this page.") });
  expect(screen.getByText(/It was cancelled/)).toBeTruthy();
  expect(screen.getByRole("alert").textContent).toContain("The results stay in this page.");
});
