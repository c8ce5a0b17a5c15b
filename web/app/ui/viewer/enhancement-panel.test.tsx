// @vitest-environment happy-dom
import { act, cleanup, render, screen } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import type { Training } from "#client/wire/render";
import { COURTYARD, serverConfig } from "#fakes/server";
import { asSession, type FakeSession, fakeSession } from "#fakes/session";
import { fetchScene, training } from "#viewer/state/api";
import { config } from "../../state/app";
import { SceneTraining } from "./enhancement-panel";

vi.mock("#viewer/state/api");

const IDLE: Training = { state: "idle", progress: 0, stage: "", problem: null };
const HALF: Training = { ...IDLE, state: "running", progress: 0.5, stage: "training rung 2" };

let session: FakeSession;

beforeEach(() => {
  vi.resetAllMocks();
  vi.useFakeTimers({ toFake: ["setInterval", "clearInterval"] });
  session = fakeSession();
  config.value = serverConfig();
  vi.mocked(training).mockResolvedValue(IDLE);
});

afterEach(() => {
  cleanup();
  vi.useRealTimers();
});

const show = () => render(<SceneTraining session={asSession(session)} />);
/** The next poll, triggered by a timer once the page knows that a training is running. */
const next = async () => {
  await vi.waitFor(() => expect(vi.getTimerCount()).toBe(1));
  await act(async () => {
    await vi.advanceTimersByTimeAsync(1000);
  });
};

test("a training is begun, followed and stopped", async () => {
  show();
  const begin = await screen.findByRole("button", { name: "Train a network for this scene" });
  vi.mocked(training).mockResolvedValue(HALF);
  await userEvent.click(begin);
  expect(training).toHaveBeenLastCalledWith(COURTYARD.id, "POST");
  expect(await screen.findByRole("progressbar")).toHaveProperty("value", 0.5);
  expect(screen.getByText("training rung 2")).toBeTruthy();
  vi.mocked(training).mockResolvedValue(IDLE);
  await userEvent.click(screen.getByRole("button", { name: "Stop" }));
  expect(training).toHaveBeenCalledWith(COURTYARD.id, "DELETE");
  expect(await screen.findByRole("button", { name: /^Train/ })).toBeTruthy();
});

test("the networks of a training that ends are used at once, also where there were some", async () => {
  vi.mocked(training).mockResolvedValue(HALF);
  vi.mocked(fetchScene).mockResolvedValue({ ...COURTYARD, enhance: "scene" });
  show();
  await screen.findByRole("progressbar");
  vi.mocked(training).mockResolvedValue({ ...IDLE, state: "done", progress: 1 });
  await next();
  await vi.waitFor(() => expect(session.scene.value?.enhance).toBe("scene"));
  expect(session.pictures.enhancement.renewals).toBe(0);

  vi.mocked(training).mockResolvedValue(HALF);
  await userEvent.click(screen.getByRole("button", { name: "Retrain the network for this scene" }));
  vi.mocked(training).mockResolvedValue({ ...IDLE, state: "done", progress: 1 });
  await next();
  await vi.waitFor(() => expect(session.pictures.enhancement.renewals).toBe(1));
});

test("a server that cannot train says why, and offers nothing", async () => {
  const missing = "Training needs PyTorch, which this server does not have.";
  config.value = { ...serverConfig(), why_no_training: missing };
  show();
  expect(await screen.findByText(missing)).toBeTruthy();
  expect(screen.queryByRole("button")).toBeNull();
});

test("what went wrong is said, and another try is offered", async () => {
  const changed = "The scene's file has changed since these weights were trained; train them again.";
  vi.mocked(training).mockResolvedValue({ ...IDLE, problem: changed });
  show();
  expect((await screen.findByRole("alert")).textContent).toBe(changed);
  vi.mocked(training).mockRejectedValue(new ApiError("The networks of garden are being trained.", false));
  await userEvent.click(screen.getByRole("button", { name: /^Train/ }));
  expect(screen.getByRole("alert").textContent).toBe("The networks of garden are being trained.");
  expect(screen.getByRole("button", { name: /^Train/ })).toBeTruthy();
});
