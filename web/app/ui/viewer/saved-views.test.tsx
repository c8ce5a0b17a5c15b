// @vitest-environment happy-dom
import { act, cleanup, render, screen, waitFor, within } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import type { SceneEdit, SceneInfo } from "#client/wire/render";
import { COURTYARD, serverConfig } from "#fakes/server";
import { asSession, type FakeSession, fakeSession } from "#fakes/session";
import { exportVideo } from "#viewer/control/video-export";
import { editScene } from "#viewer/state/api";
import { config } from "../../state/app";
import { save } from "../save";
import { CameraPaths } from "./camera-paths";
import { SavedViews, StartView } from "./saved-views";
import { ViewMenu } from "./view-menu";

vi.mock("#viewer/state/api");
vi.mock("#viewer/control/video-export");
vi.mock("../save", async (original) => ({ ...(await original<typeof import("../save")>()), save: vi.fn() }));

const at = (x: number) =>
  ({ position: [x, 0, 0], quaternion: [0, 0, 0, 1] }) as never as {
    position: [number, number, number];
    quaternion: [number, number, number, number];
  };
const GATE = at(7);
const TOUR = {
  keyframes: [0, 1000, 2000].map((t_ms, x) => ({ t_ms, ...at(x) })),
  easing: "linear",
  loop: false,
} as const;
const SCENE: SceneInfo = {
  ...COURTYARD,
  builtin: false,
  up: [0, -1, 0],
  camera: { position: [0, 0, -5], look_at: [0, 0, 0] },
  views: { Gate: GATE },
  paths: { Tour: { ...TOUR, keyframes: [...TOUR.keyframes] } },
};
let session: FakeSession;
let scenes = 0;

/** Stands in for the server: returns the scene with the edit. */
async function edited(_: string, { views = {}, paths = {}, camera }: SceneEdit): Promise<SceneInfo> {
  const merged = <Saved,>(now: Record<string, Saved> = {}, change: Record<string, Saved | null>) =>
    Object.fromEntries(
      Object.entries({ ...now, ...change }).flatMap(([name, value]) => (value === null ? [] : [[name, value]])),
    );
  const scene = session.scene.value as SceneInfo;
  const kept = { views: merged(scene.views, views), paths: merged(scene.paths, paths) };
  return { ...scene, ...(camera && { camera }), ...kept };
}

beforeEach(() => {
  vi.resetAllMocks();
  vi.mocked(editScene).mockImplementation(edited);
  session = fakeSession();
  const id = `scene ${scenes++}`; // unsaved paths are kept for the scene
  session.scene.value = { ...SCENE, id };
  session.rig.enter({ ...SCENE, id });
  stand(3);
  config.value = { ...serverConfig(), max_upload_bytes: 1e9 };
});
afterEach(cleanup);

function stand(x: number): void {
  session.rig.place(at(x));
  session.rig.sample(0);
}

const button = (name: string) => screen.getByRole("button", { name });
const press = (name: string) => userEvent.click(button(name));
const lastEdit = () => vi.mocked(editScene).mock.lastCall?.[1];
const rounded = (vector: readonly number[] | null | undefined) => vector?.map((x) => Math.round(x * 1000) / 1000 + 0);
const where = () => session.rig.pose.position.map((value) => Math.round(value * 1000) / 1000)[0];

/** Lets the camera move for as long as it takes. */
async function arrive(): Promise<void> {
  for (let now = 0; now <= 20_000; now += 500) await act(() => void session.rig.sample(now));
}

test("the present view is saved under a free name or one's own, and the camera goes to a saved one", async () => {
  render(<SavedViews session={asSession(session)} />);
  await press("Save this view");
  expect(Object.keys(lastEdit()?.views ?? {})).toEqual(["View 1"]);
  expect(lastEdit()?.views?.["View 1"]?.position[0]).toBeCloseTo(3);
  const name = screen.getByLabelText("Name") as HTMLInputElement;
  expect(name.value).toBe("View 2");
  await userEvent.clear(name);
  await userEvent.type(name, " Pond ");
  await press("Save this view");
  expect(Object.keys(lastEdit()?.views ?? {})).toEqual(["Pond"]);
  await press("Gate");
  await arrive();
  expect(where()).toBe(7);
});

test("a name that is taken replaces nothing", async () => {
  render(<SavedViews session={asSession(session)} />);
  await userEvent.clear(screen.getByLabelText("Name"));
  await userEvent.type(screen.getByLabelText("Name"), "Gate");
  await press("Save this view");
  expect(screen.getByRole("alert").textContent).toContain("A view named “Gate” already exists");
  await press("Rename: Gate");
  expect(editScene).not.toHaveBeenCalled();
});

test("a view is renamed and deleted once that is confirmed", async () => {
  render(<SavedViews session={asSession(session)} />);
  await press("Rename: Gate");
  const dialog = within(await screen.findByRole("dialog", { name: "Rename “Gate”" }));
  await userEvent.clear(dialog.getByRole("textbox"));
  await userEvent.type(dialog.getByRole("textbox"), "Door");
  await userEvent.click(dialog.getByRole("button", { name: "Rename" }));
  await waitFor(() => expect(lastEdit()).toEqual({ views: { Gate: null, Door: GATE } }));
  await press("Delete: Door");
  await userEvent.click(within(await screen.findByRole("dialog")).getByRole("button", { name: "Delete" }));
  await waitFor(() => expect(lastEdit()).toEqual({ views: { Door: null } }));
  expect(screen.queryByRole("button", { name: "Door" })).toBeNull();
});

test("a refusal is shown, and the typed name stays", async () => {
  vi.mocked(editScene).mockRejectedValue(new ApiError("The disk that holds the models is full.", false));
  const { unmount } = render(<StartView session={asSession(session)} />);
  const scene = session.scene.value;
  await press("This way is up");
  expect((await screen.findByRole("alert")).textContent).toContain("disk");
  expect(session.scene.value).toBe(scene);
  unmount();
  render(<SavedViews session={asSession(session)} />);
  await userEvent.clear(screen.getByLabelText("Name"));
  await userEvent.type(screen.getByLabelText("Name"), "Pond");
  await press("Save this view");
  expect((await screen.findByRole("alert")).textContent).toContain("disk");
  expect((screen.getByLabelText("Name") as HTMLInputElement).value).toBe("Pond");
});

test("the present view becomes the start view", async () => {
  render(<StartView session={asSession(session)} />);
  stand(1);
  await press("Use this view as the start view");
  expect(lastEdit()?.up).toEqual([0, -1, 0]);
  expect(rounded(lastEdit()?.camera?.position)).toEqual([1, 0, 0]);
  expect(rounded(lastEdit()?.camera?.look_at)).toEqual([1, 0, 5]);
  await waitFor(() => expect(rounded(session.rig.pose.position)).toEqual([1, 0, 0]));
});

test("the viewing direction becomes up, and the picture's bottom the new start view", async () => {
  render(<StartView session={asSession(session)} />);
  stand(0);
  await press("This way is up");
  expect(rounded(lastEdit()?.up)).toEqual([0, 0, 1]);
  expect(rounded(lastEdit()?.camera?.look_at)).toEqual([0, 5, 0]);
});

test("a path is built from views, timed, played and saved", async () => {
  render(<CameraPaths session={asSession(session)} />);
  await userEvent.click(screen.getByLabelText(/New path/));
  for (const x of [1, 2, 4]) {
    stand(x);
    await press("Add this view as a keyframe");
  }
  await press("Remove keyframe 2");
  const duration = screen.getByLabelText(/Duration/);
  await userEvent.clear(duration);
  await userEvent.type(duration, "12{Enter}");
  await userEvent.selectOptions(screen.getByLabelText("Speed"), "Constant");
  await press("Play path");
  await act(() => void session.rig.sample(100));
  await act(() => void session.rig.sample(4100));
  expect(where()).toBe(2); // a third of the way from 1 to 4
  await press("Stop path");
  expect(session.rig.source.value).toBeNull();
  await waitFor(() => button("Play path"));
  await press("Save path");
  const path = lastEdit()?.paths?.["Path 1"];
  expect(path?.keyframes.map(({ t_ms, position }) => [t_ms, position[0]])).toEqual([
    [0, 1],
    [12_000, 4],
  ]);
  expect(path).toMatchObject({ easing: "linear", loop: false });
  expect((screen.getByLabelText(/Path 1/) as HTMLInputElement).checked).toBe(true);
});

test("a saved path is renamed with its changes, which wait while another is looked at or the lab is closed", async () => {
  const { unmount } = render(<CameraPaths session={asSession(session)} />);
  await userEvent.click(screen.getByLabelText(/Tour/));
  await userEvent.click(screen.getByLabelText("Loop back to the start"));
  await userEvent.clear(screen.getByLabelText("Path name"));
  await userEvent.type(screen.getByLabelText("Path name"), "Round trip");
  await userEvent.click(screen.getByLabelText(/New path/));
  expect(screen.queryByLabelText("Path name")).toBeNull();
  unmount();
  render(<CameraPaths session={asSession(session)} />);
  await userEvent.click(screen.getByLabelText(/Tour/));
  await press("Save path");
  expect(lastEdit()?.paths).toMatchObject({ Tour: null, "Round trip": { loop: true } });
  expect(lastEdit()?.paths?.["Round trip"]?.keyframes.map(({ position }) => position[0])).toEqual([0, 1, 2, 0]);
  await press("Delete path");
  await userEvent.click(within(await screen.findByRole("dialog")).getByRole("button", { name: "Delete" }));
  await waitFor(() => expect(lastEdit()).toEqual({ paths: { "Round trip": null } }));
});

test("a path becomes a video, with progress and a way to cancel", async () => {
  const made = vi.mocked(exportVideo).mockImplementation((_, __, { onProgress, signal } = {}) => {
    onProgress?.(0.25);
    return new Promise((_, reject) => signal?.addEventListener("abort", reject));
  });
  render(<CameraPaths session={asSession(session)} />);
  await userEvent.click(screen.getByLabelText(/Tour/));
  await press("Save as video");
  expect((screen.getByRole("progressbar") as HTMLProgressElement).value).toBe(0.25);
  await press("Cancel");
  await waitFor(() => button("Save as video"));
  expect(save).not.toHaveBeenCalled();
  expect(screen.queryByRole("alert")).toBeNull();
  made.mockResolvedValue(new Blob(["mp4"], { type: "video/mp4" }));
  await press("Save as video");
  await waitFor(() => expect(save).toHaveBeenCalledWith("Tour.mp4", expect.any(Blob)));
  const path = made.mock.lastCall?.[1];
  expect([path?.duration, path?.at(1500).position[0]]).toEqual([2000, 1.5]);
});

test.each([
  ["a built-in scene", { builtin: true }, 1e9],
  ["a server that lets pages change nothing", {}, null],
])("%s has views to go to and paths to play, but nothing to save", async (_, change, max_upload_bytes) => {
  session.scene.value = { ...(session.scene.value as SceneInfo), ...change };
  config.value = { ...serverConfig(), max_upload_bytes };
  render(<SavedViews session={asSession(session)} />);
  render(<StartView session={asSession(session)} />);
  render(<CameraPaths session={asSession(session)} />);
  await userEvent.click(screen.getByLabelText(/Tour/));
  for (const name of [/Save this view/, /start view/, /is up/, /Rename/, /Delete/, /Save path/]) {
    expect(screen.queryByRole("button", { name })).toBeNull();
  }
  for (const name of ["Gate", "Play path", "Save as video", "Add this view as a keyframe"]) button(name);
});

test("visitors find views and paths in the menu, if there are any", async () => {
  render(<ViewMenu session={asSession(session)} onReset={vi.fn()} onClose={vi.fn()} />);
  await press("Tour");
  await arrive();
  expect(where()).toBe(2);
  await press("Gate");
  await arrive();
  expect(where()).toBe(7);
  await act(() => {
    session.scene.value = COURTYARD;
  });
  expect(screen.queryByText("Saved views")).toBeNull();
});
