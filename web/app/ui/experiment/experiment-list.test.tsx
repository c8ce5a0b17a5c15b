// @vitest-environment happy-dom

import { cleanup, render, screen, within } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { serverConfig } from "#fakes/server";
import { fetchConfig, fetchScenes } from "#viewer/state/api";
import { config } from "../../state/app";
import { ExperimentList } from "./experiment-list";

vi.mock("#viewer/state/api");

const SUMMARY = {
  id: "e1",
  name: "Bus",
  created: "2026-01-02T10:00:00Z",
  source: "page",
  planned: 4,
  runs: 4,
  complete: 4,
};
const UNFINISHED = { ...SUMMARY, id: "e2", name: "Train", complete: 1 };
const BY_COMMAND = { ...UNFINISHED, id: "e3", name: "Tram", source: "command" };

/** The store's answers, by path. */
let answers: Record<string, unknown>;
let deleted: string[];

beforeEach(() => {
  location.hash = "#/experiments";
  config.value = serverConfig({ store: "http://store.test" });
  vi.mocked(fetchConfig).mockImplementation(async () => config.value ?? serverConfig());
  vi.mocked(fetchScenes).mockResolvedValue([]);
  answers = { "/experiments": { experiments: [SUMMARY, UNFINISHED, BY_COMMAND] } };
  deleted = [];
  vi.stubGlobal("fetch", async (url: string, { method }: RequestInit = {}) => {
    if (method === "DELETE") {
      deleted.push(url);
      answers["/experiments"] = { experiments: [UNFINISHED, BY_COMMAND] };
      return new Response(null, { status: 204 });
    }
    const answer = answers[url.replace("http://store.test", "")];
    if (answer === undefined) throw new TypeError("refused");
    return Response.json(answer);
  });
});

afterEach(cleanup);

const row = async (name: RegExp) => within(await screen.findByRole("row", { name }));

test("each experiment says how far it is, with its report and its files", async () => {
  render(<ExperimentList />);
  const bus = await row(/^Bus/);
  expect(bus.getAllByRole("cell")[0]?.textContent).toBe("4");
  expect(bus.getByRole("link", { name: "Report" }).getAttribute("href")).toBe(
    "http://store.test/experiments/e1/report",
  );
  expect(bus.getByRole("link", { name: "Bus" }).getAttribute("href")).toBe("http://store.test/experiments/e1/report");
  expect(bus.getByRole("link", { name: "ZIP" }).getAttribute("href")).toBe("http://store.test/experiments/e1/zip");
  const train = await row(/^Train/);
  expect(train.getAllByRole("cell")[0]?.textContent).toBe("1 of 4, incomplete");
});

test("only what a page began and did not finish can be continued", async () => {
  render(<ExperimentList />);
  expect((await row(/^Bus/)).queryByRole("link", { name: "Continue" })).toBeNull();
  expect((await row(/^Tram/)).queryByRole("link", { name: "Continue" })).toBeNull();
  const link = (await row(/^Train/)).getByRole("link", { name: "Continue" });
  expect(link.getAttribute("href")).toBe("#/experiments/e2/run");
});

test("one is deleted once a person says yes", async () => {
  render(<ExperimentList />);
  const ask = async (answer: string) => {
    await userEvent.click((await row(/^Bus/)).getByRole("button", { name: "Delete Bus" }));
    const question = within(await screen.findByRole("dialog", { name: "Delete “Bus”?" }));
    expect(question.getByText(/^Its 4 runs from Jan 2, 2026, .* cannot be undone/)).toBeTruthy();
    await userEvent.click(question.getByRole("button", { name: answer }));
  };
  await ask("Cancel");
  await vi.waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
  expect(deleted).toEqual([]);
  await ask("Delete");
  await vi.waitFor(() => expect(screen.queryByRole("row", { name: /^Bus/ })).toBeNull());
  expect(deleted).toEqual(["http://store.test/experiments/e1"]);
  expect(screen.queryByRole("dialog")).toBeNull();
});

test.each<[string, () => void, RegExp]>([
  ["is empty", () => Object.assign(answers, { "/experiments": { experiments: [] } }), /No experiments yet/],
  ["does not answer", () => delete answers["/experiments"], /The store at http:\/\/store.test is not responding/],
  ["is not there", () => Object.assign(config, { value: serverConfig() }), /This server has no experiment store/],
])("a store that %s is said", async (_, prepare, sentence) => {
  prepare();
  render(<ExperimentList />);
  expect(await screen.findByText(sentence)).toBeTruthy();
});
