// @vitest-environment happy-dom
import { act, cleanup, render, screen, waitFor } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { COURTYARD, serverConfig } from "#fakes/server";
import { type FakeSession, fakeSession } from "#fakes/session";
import { visit } from "#fakes/visit";
import { turning } from "#viewer/reproject/acceleration";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { config, settings } from "../../state/app";
import type { Asked } from "../../state/route";
import { Viewer } from "./viewer";

vi.mock("../chart/plots", () => ({ plotLive: () => () => undefined, plotDistribution: () => () => undefined }));
vi.mock("#viewer/session/session", () => import("#fakes/visit"));

let session: FakeSession;

beforeEach(() => {
  turning.value = null;
  settings.value = { ...DEFAULT_SETTINGS, sidebar: false };
  config.value = serverConfig();
  session = fakeSession();
  visit.next = session;
});

afterEach(cleanup);

const show = (asked: Asked = {}) => render(<Viewer sceneId="courtyard" asked={asked} />);

test("a link says where the camera is and what is shown how, and what makes no sense in it is said", async () => {
  show({ at: "1,2,3,0,0,0,1", mode: "local", restore: "anime4k-restore-m", prediction: "magic" });
  await act(() => void session.rig.sample(20));
  expect(session.rig.pose.position).toEqual([1, 2, 3]);
  expect(settings.value).toMatchObject({ mode: "local", restore: "anime4k-restore-m", prediction: "velocity" });
  expect(screen.getByText(/^The link sets prediction to “magic”, which is not a valid value/)).toBeTruthy();
});

test.each([
  ["Gate", 5, null],
  ["Pond", 0, "This scene has no saved view named “Pond”."],
])("a link may name the saved view %s", async (view, x, note) => {
  session.scene.value = { ...COURTYARD, views: { Gate: { position: [5, 0, 0], quaternion: [0, 0, 0, 1] } } };
  settings.value = { ...settings.value, hud: true };
  show({ view });
  await act(() => void session.rig.sample(20));
  expect(session.rig.pose.position[0]).toBeCloseTo(x);
  await waitFor(() => expect(document.querySelector("[data-stat=link-note]")?.textContent ?? null).toBe(note));
});

test("a link to the view is copied, and is the page's address", async () => {
  history.replaceState(null, "", "#/scene/courtyard");
  settings.value = { ...DEFAULT_SETTINGS, sidebar: true, depth: false };
  const copied: string[] = [];
  vi.stubGlobal("navigator", {
    ...navigator,
    clipboard: { writeText: async (text: string) => void copied.push(text) },
  });
  show();
  await userEvent.click(screen.getByRole("button", { name: "Copy a link to this view" }));
  await screen.findByRole("button", { name: "Link copied" });
  expect(copied).toEqual([location.href]);
  expect(location.hash).toMatch(/^#\/scene\/courtyard\?at=[-\d.,]+&mode=stateless&depth=off$/);
});

test("a link can insist on reprojection where there is no graphics acceleration", () => {
  turning.value = "slow";
  show({ reprojection: "on" });
  expect(turning.value).toBe("forced");
});
