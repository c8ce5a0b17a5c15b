// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { cleanup, fireEvent, render, screen } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { ExperimentRequest } from "#client/wire/store";
import { COURTYARD, serverConfig } from "#fakes/server";
import { addFile, movements } from "#viewer/movement/movement-deck";
import { readMovement } from "#viewer/movement/movement-file";
import type { ViewerSession } from "#viewer/session/session";
import { config } from "../../state/app";
import { ExperimentDialog } from "./experiment-dialog";

const WALK = readMovement("t_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n2000,1,0,0,0,0,0,1\n");

let asked: { path: string; request: ExperimentRequest | null }[];
let refusal: string | null;

beforeEach(() => {
  location.hash = "";
  movements.value = [];
  asked = [];
  refusal = null;
  config.value = serverConfig({ store: "http://store.test" });
  vi.stubGlobal("fetch", async (url: string, { body = "null" }: { body?: string } = {}) => {
    const path = url.replace("http://store.test/", "");
    asked.push({ path, request: JSON.parse(body) as ExperimentRequest });
    if (path === "movements") {
      const stroll = { name: "stroll-2", duration_ms: 60_000, anchor: "start", description: "" };
      return Response.json({ movements: [stroll] });
    }
    if (path === "plans") return Response.json({ runs: 2, lasting: "6 minutes", problem: refusal });
    if (refusal !== null) return Response.json({ type: "tigas:x", detail: refusal }, { status: 400 });
    return Response.json({ id: "walk-1" }, { status: 201 });
  });
});

afterEach(cleanup);

async function opened() {
  const session = {
    scene: signal(COURTYARD),
    movement: { movement: signal(null) },
    unturned: signal(null),
  };
  render(<ExperimentDialog session={session as unknown as ViewerSession} open={signal(true)} />);
  await screen.findByRole("option", { name: /stroll-2/ });
}

const start = () => userEvent.click(screen.getByRole("button", { name: "Start" }));
const created = () => asked.find(({ path }) => path === "experiments")?.request;

test("the form is a file that the store expands and begins", async () => {
  await opened();
  expect(await screen.findByText("2 runs, about 6 minutes.")).toBeTruthy();
  await userEvent.click(screen.getByRole("checkbox", { name: "LoL+" }));
  await start();
  await vi.waitFor(() => expect(location.hash).toBe("#/experiments/walk-1/run"));
  expect(created()?.file).toContain('controllers = ["seen","latency","lol+"]\n');
  expect(created()?.file).toContain('movements = ["stroll-2.csv"]\n');
  expect(created()?.movements).toEqual({});
});

test("a movement of this visit goes with the file", async () => {
  addFile("my walk.csv", WALK);
  await opened();
  fireEvent.change(screen.getByRole("combobox", { name: "Movement" }), { target: { value: "file/my walk.csv" } });
  await start();
  await vi.waitFor(() => expect(created()).toBeDefined());
  expect(created()?.file).toContain('movements = ["my walk.csv"]\n');
  expect(readMovement(created()?.movements?.["my walk.csv"] ?? "").duration).toBe(2000);
});

test("an edited file replaces the form, which can be had back", async () => {
  await opened();
  const file = screen.getByRole<HTMLTextAreaElement>("textbox", { name: "Experiment file" });
  const written = file.value;
  fireEvent.input(file, { target: { value: '{"name": "mine"}' } });
  expect(
    screen.getByRole<HTMLInputElement>("textbox", { name: "Name" }).matches(":disabled, fieldset:disabled *"),
  ).toBe(true);
  await start();
  await vi.waitFor(() => expect(created()?.file).toBe('{"name": "mine"}'));
  await userEvent.click(screen.getByRole("button", { name: "Back to the form" }));
  expect(file.value).toBe(written);
});

test("what the store refuses is said, and gone once it is being mended", async () => {
  refusal = "The file: repeats: input should be a valid integer.";
  await opened();
  await start();
  expect((await screen.findByRole("alert")).textContent).toBe(refusal);
  expect(location.hash).toBe("");
  refusal = null;
  fireEvent.input(screen.getByRole("textbox", { name: "Repeats" }), { target: { value: "3" } });
  expect(screen.getByRole("alert").textContent).toBe("");
  expect(await screen.findByText("2 runs, about 6 minutes.")).toBeTruthy();
});

test("without a store there is nothing to begin", () => {
  config.value = serverConfig();
  const session = {
    scene: signal(COURTYARD),
    movement: { movement: signal(null) },
    unturned: signal(null),
  };
  render(<ExperimentDialog session={session as unknown as ViewerSession} open={signal(true)} />);
  expect(screen.getByRole("dialog").textContent).toContain("Experiments need a store");
  expect(screen.queryByRole("button", { name: "Start" })).toBeNull();
});
