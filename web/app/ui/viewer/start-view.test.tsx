// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import type { SceneInfo } from "#client/wire/render";
import { editScene } from "#viewer/state/api";
import { COURTYARD, serverConfig } from "#viewer/state/fake-server";
import { config } from "../../state/app";
import { asSession, type FakeSession, fakeSession } from "../../state/fake-session";
import { StartView } from "./saved-views";

vi.mock("#viewer/state/api");

const SCENE: SceneInfo = {
  ...COURTYARD,
  builtin: false,
  up: [0, -1, 0],
  camera: { position: [0, 0, -5], look_at: [0, 0, 0] },
};
let session: FakeSession;

beforeEach(() => {
  vi.resetAllMocks();
  session = fakeSession();
  session.scene.value = SCENE;
  session.rig.enter(SCENE);
  config.value = { ...serverConfig(), max_upload_bytes: 1e9 };
});
afterEach(cleanup);

const rounded = (vector: readonly number[] | undefined) => vector?.map((x) => Math.round(x * 1000) / 1000 + 0);

test("the present view is stored, and the viewer starts there from now on", async () => {
  const stored = { ...SCENE, camera: { position: [1, 0, -5], look_at: [1, 0, 0] } } as SceneInfo;
  vi.mocked(editScene).mockResolvedValue(stored);
  session.rig.place({ position: [1, 0, -5], quaternion: [0, 0, 0, 1] });
  session.rig.sample(0);
  render(<StartView session={asSession(session)} />);
  await userEvent.click(screen.getByRole("button", { name: "Use this view as the start view" }));
  const [id, view] = vi.mocked(editScene).mock.lastCall ?? [];
  expect([id, view?.up]).toEqual([SCENE.id, [0, -1, 0]]);
  expect(rounded(view?.camera?.position)).toEqual([1, 0, -5]);
  expect(rounded(view?.camera?.look_at)).toEqual([1, 0, 0]);
  await vi.waitFor(() => expect(session.scene.value).toBe(stored));
});

test("the viewing direction becomes up, and the picture's bottom the new start view", async () => {
  vi.mocked(editScene).mockResolvedValue(SCENE);
  render(<StartView session={asSession(session)} />);
  await userEvent.click(screen.getByRole("button", { name: "This way is up" }));
  const view = vi.mocked(editScene).mock.lastCall?.[1];
  expect(rounded(view?.up ?? [])).toEqual([0, 0, 1]);
  expect(rounded(view?.camera?.look_at)).toEqual([0, 5, -5]);
});

test("a refusal is shown, and changes nothing", async () => {
  vi.mocked(editScene).mockRejectedValue(new ApiError("The disk that holds the models is full.", false));
  render(<StartView session={asSession(session)} />);
  await userEvent.click(screen.getByRole("button", { name: "This way is up" }));
  expect((await screen.findByRole("alert")).textContent).toContain("disk");
  expect(session.scene.value).toBe(SCENE);
});

test.each([
  ["a built-in scene", { builtin: true }, 1e9],
  ["a server that lets pages change nothing", {}, null],
])("%s has no buttons", (_, change, max_upload_bytes) => {
  session.scene.value = { ...SCENE, ...change };
  config.value = { ...serverConfig(), max_upload_bytes };
  render(<StartView session={asSession(session)} />);
  expect(screen.queryByRole("button")).toBeNull();
});
