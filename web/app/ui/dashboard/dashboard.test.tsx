// @vitest-environment happy-dom
import { cleanup, render, screen, waitFor, within } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import { COURTYARD, serverConfig } from "#fakes/server";
import { deleteScene, fetchConfig, fetchScenes, loadScene, renameScene, unloadScene } from "#viewer/state/api";
import { config, scenes, scenesError } from "../../state/app";
import { added } from "../../uploads/uploads";
import { Dashboard } from "./dashboard";

vi.mock("#viewer/state/api");

const PEBBLES = { ...COURTYARD, id: "pebbles", name: "Pebbles", state: "unloaded", gaussians: 2000 } as const;
const BROKEN = { ...COURTYARD, id: "torn", name: "Torn", state: "broken", error: "Its PLY file ends early." } as const;

beforeEach(() => {
  vi.clearAllMocks();
  config.value = null;
  scenes.value = null;
  scenesError.value = null;
  added.value = new Set();
  vi.mocked(fetchConfig).mockResolvedValue(serverConfig());
  vi.mocked(fetchScenes).mockResolvedValue([COURTYARD, PEBBLES, BROKEN]);
});

afterEach(() => {
  cleanup();
  vi.useRealTimers();
});

const card = async (name: string) => (await screen.findByRole("heading", { name })).closest("li") as HTMLElement;

test("each scene says what it is and opens the viewer; a broken one says why it cannot", async () => {
  render(<Dashboard />);
  expect(screen.getByRole("status").textContent).toBe("Loading scenes…");
  const courtyard = within(await card("Courtyard"));
  expect(courtyard.getByRole("link").getAttribute("href")).toBe("#/scene/courtyard");
  expect(courtyard.getByText("299 k Gaussians · 20 MB · SH degree 3")).toBeTruthy();
  expect(courtyard.getByText("In memory").textContent).toBe("In memory · 40 MB");
  const broken = within(await card("Torn"));
  expect(broken.getByText("Its PLY file ends early.")).toBeTruthy();
  expect(broken.queryByRole("link")).toBeNull();
  expect(screen.getByRole("status").textContent).toBe("3 scenes on this server");
});

test("a scene that was just added comes first, and leads to the viewer", async () => {
  added.value = new Set(["pebbles"]);
  render(<Dashboard />);
  const pebbles = await card("Pebbles");
  expect(screen.getAllByRole("heading", { level: 2 }).map(({ textContent }) => textContent)).toEqual([
    "Pebbles",
    "Courtyard",
    "Torn",
  ]);
  expect(within(pebbles).getByRole("link", { name: "Open" }).getAttribute("href")).toBe("#/scene/pebbles");
  expect(screen.getAllByRole("link", { name: "Open" })).toHaveLength(1);
});

test("a scene whose picture has come is in memory, and the list says so", async () => {
  vi.useFakeTimers();
  render(<Dashboard />);
  await vi.advanceTimersByTimeAsync(1100);
  expect(fetchScenes).toHaveBeenCalledTimes(1);
  vi.mocked(fetchScenes).mockResolvedValue([COURTYARD, { ...PEBBLES, state: "loaded" }, BROKEN]);
  const pebbles = screen.getByRole("heading", { name: "Pebbles" }).closest("li") as HTMLElement;
  pebbles.querySelector("img")?.dispatchEvent(new Event("load"));
  await vi.advanceTimersByTimeAsync(1100);
  expect(within(pebbles).getByText("In memory")).toBeTruthy();
  await vi.advanceTimersByTimeAsync(5000);
  expect(fetchScenes).toHaveBeenCalledTimes(2);
});

test("what a rescan has found is said for a while", async () => {
  vi.useFakeTimers();
  vi.mocked(fetchScenes).mockResolvedValueOnce([COURTYARD]);
  render(<Dashboard />);
  await vi.advanceTimersByTimeAsync(10);
  screen.getByRole("button", { name: "Rescan folder" }).click();
  await vi.advanceTimersByTimeAsync(10);
  expect(screen.getByRole("status").textContent).toContain("New: Pebbles.");
  await vi.advanceTimersByTimeAsync(11_000);
  expect(screen.getByRole("status").textContent).toBe("3 scenes on this server");
});

test("the list is not read again during a rescan", async () => {
  vi.useFakeTimers();
  let scanned = (_: (typeof COURTYARD)[]) => {};
  vi.mocked(fetchScenes)
    .mockResolvedValueOnce([{ ...COURTYARD, state: "loading" }])
    .mockReturnValueOnce(new Promise((resolve) => (scanned = resolve)))
    .mockResolvedValue([COURTYARD]);
  render(<Dashboard />);
  await vi.advanceTimersByTimeAsync(10);
  screen.getByRole("button", { name: "Rescan folder" }).click();
  await vi.advanceTimersByTimeAsync(5000);
  scanned([COURTYARD, { ...COURTYARD, id: "new", name: "Quarry" }]);
  await vi.advanceTimersByTimeAsync(10);
  expect(screen.getByText("Quarry")).toBeTruthy();
  expect(screen.getByRole("status").textContent).toContain("New: Quarry.");
});

test("scenes are found by what is typed, and / goes there", async () => {
  const user = userEvent.setup();
  render(<Dashboard />);
  await card("Pebbles");
  await user.keyboard("/peb");
  await waitFor(() => expect(screen.queryByRole("heading", { name: "Courtyard" })).toBeNull());
  expect(screen.getByRole("status").textContent).toBe("1 of 3 scenes");
  await user.keyboard("x");
  expect(await screen.findByText("No scenes match “pebx”")).toBeTruthy();
});

test("a scene is loaded and unloaded, and says so meanwhile", async () => {
  const user = userEvent.setup();
  let loaded = (_: typeof COURTYARD) => {};
  vi.mocked(loadScene).mockReturnValue(new Promise((resolve) => (loaded = resolve)));
  vi.mocked(unloadScene).mockResolvedValue({ ...PEBBLES });
  render(<Dashboard />);
  await card("Pebbles");
  await user.click(screen.getByRole("button", { name: "Load: Pebbles" }));
  expect(await screen.findByText("Loading…")).toBeTruthy();
  loaded({ ...PEBBLES, state: "loaded" });
  await user.click(await screen.findByRole("button", { name: "Unload: Pebbles" }));
  expect(await screen.findByText("Not loaded")).toBeTruthy();
  expect(unloadScene).toHaveBeenCalledWith("pebbles");
});

test("a scene that is loading shows how far it is, again and again", async () => {
  vi.useFakeTimers();
  const loading = (progress: number) => [{ ...PEBBLES, state: "loading", progress } as const];
  vi.mocked(fetchScenes).mockResolvedValueOnce(loading(0.25)).mockResolvedValue(loading(0.75));
  render(<Dashboard />);
  await vi.advanceTimersByTimeAsync(10);
  const bar = screen.getByLabelText<HTMLProgressElement>("Loading Pebbles");
  expect(bar.value).toBe(0.25);
  await vi.advanceTimersByTimeAsync(1100);
  expect(bar.value).toBe(0.75);
});

test("a server that does not answer is said once, and asked until it does", async () => {
  vi.useFakeTimers();
  vi.mocked(fetchScenes).mockRejectedValueOnce(new ApiError("The server is not responding.", true));
  render(<Dashboard />);
  await vi.advanceTimersByTimeAsync(10);
  expect(screen.getByRole("alert").textContent).toBe("The server is not responding.");
  await vi.advanceTimersByTimeAsync(2100);
  expect(screen.queryByRole("alert")).toBeNull();
  expect(screen.getByText("Pebbles")).toBeTruthy();
  await vi.advanceTimersByTimeAsync(10_000);
  expect(fetchScenes).toHaveBeenCalledTimes(2);
});

test("a server without scenes says where they go, and looks again on request", async () => {
  const user = userEvent.setup();
  vi.mocked(fetchScenes).mockResolvedValueOnce([]);
  render(<Dashboard />);
  expect(await screen.findByText("No scenes yet")).toBeTruthy();
  await user.click(screen.getByRole("button", { name: "Rescan folder" }));
  await card("Pebbles");
  expect(fetchScenes).toHaveBeenLastCalledWith({ scan: true });
});

test.each([
  [{}, false],
  [{ store: "http://store.test" }, true],
])("with the services %j there are experiments: %s", async (services, offered) => {
  vi.mocked(fetchConfig).mockResolvedValue(serverConfig(services));
  render(<Dashboard />);
  await card("Pebbles");
  expect(screen.queryByRole("link", { name: "Experiments" }) !== null).toBe(offered);
});

test("scenes are changed only where the server lets the page, and never the built-in one", async () => {
  vi.mocked(fetchScenes).mockResolvedValue([{ ...COURTYARD, builtin: true }, PEBBLES]);
  render(<Dashboard />);
  await card("Pebbles");
  expect(screen.queryByRole("button", { name: /Rename|Delete|Add/ })).toBeNull();
  config.value = { ...serverConfig(), max_upload_bytes: 1000 };
  expect(await screen.findByRole("button", { name: "Add scenes" })).toBeTruthy();
  expect(screen.getAllByRole("button", { name: /Rename|Delete/ })).toHaveLength(2);
});

test("a question stays with a sentence if the server refuses, and goes once it is done", async () => {
  const user = userEvent.setup();
  vi.mocked(fetchConfig).mockResolvedValue({ ...serverConfig(), max_upload_bytes: 1000 });
  vi.mocked(renameScene).mockRejectedValueOnce(new ApiError("There is a scene torn already.", false));
  vi.mocked(deleteScene).mockResolvedValue();
  render(<Dashboard />);
  await card("Pebbles");
  await user.click(screen.getByRole("button", { name: "Rename: Pebbles" }));
  const field = await screen.findByRole("textbox", { name: "New name" });
  await user.clear(field);
  await user.type(field, " torn {Enter}");
  expect((await screen.findByRole("alert")).textContent).toBe("There is a scene torn already.");
  expect(renameScene).toHaveBeenCalledWith("pebbles", "torn");
  await user.click(screen.getByRole("button", { name: "Cancel" }));
  await user.click(screen.getByRole("button", { name: "Delete: Pebbles" }));
  vi.mocked(fetchScenes).mockResolvedValue([COURTYARD]);
  await user.click(await screen.findByRole("button", { name: "Delete" }));
  await waitFor(() => expect(screen.queryByRole("heading", { name: "Pebbles" })).toBeNull());
  expect(deleteScene).toHaveBeenCalledWith("pebbles");
  expect(screen.queryByRole("dialog")).toBeNull();
});

test("the focus goes on to the renamed scene, and from a deleted one to its neighbour or the filter", async () => {
  const user = userEvent.setup();
  vi.mocked(fetchConfig).mockResolvedValue({ ...serverConfig(), max_upload_bytes: 1000 });
  vi.mocked(deleteScene).mockResolvedValue();
  const stones = { ...PEBBLES, id: "stones", name: "Stones" };
  vi.mocked(renameScene).mockResolvedValue(stones);
  render(<Dashboard />);
  await card("Pebbles");
  const focused = () => document.activeElement?.textContent;

  await user.click(screen.getByRole("button", { name: "Rename: Pebbles" }));
  vi.mocked(fetchScenes).mockResolvedValue([COURTYARD, BROKEN, stones]);
  await user.type(await screen.findByRole("textbox", { name: "New name" }), "stones{Enter}");
  await waitFor(() => expect(focused()).toBe("Stones"));

  await user.click(screen.getByRole("button", { name: "Delete: Courtyard" }));
  vi.mocked(fetchScenes).mockResolvedValue([stones]);
  await user.click(await screen.findByRole("button", { name: "Delete" }));
  await waitFor(() => expect(focused()).toBe("Stones"));

  await user.click(screen.getByRole("button", { name: "Delete: Stones" }));
  vi.mocked(fetchScenes).mockResolvedValue([]);
  await user.click(await screen.findByRole("button", { name: "Delete" }));
  await waitFor(() => expect(document.activeElement).toBe(screen.getByRole("searchbox")));
});
