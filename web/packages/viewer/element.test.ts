// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import { connect } from "#client/transport/connect";
import { settle } from "#fakes/transport";
import type { ViewerEvents } from "./create-viewer";
import type { TigasViewer } from "./element";
import "./element";
import { FakePage } from "#fakes/page";
import { COURTYARD, serverConfig } from "#fakes/server";
import { fetchConfig, loadScene } from "./state/api";

vi.mock("./state/api");
vi.mock("#client/transport/connect");

const AT = "1,-2,3,0,0,0,1";
let host: FakePage;

beforeEach(() => {
  vi.clearAllMocks();
  host = new FakePage();
  vi.mocked(fetchConfig).mockImplementation(async () => serverConfig());
  vi.mocked(loadScene).mockImplementation(async (id) => ({ ...COURTYARD, id, name: id }));
  vi.mocked(connect).mockImplementation(async () => host.connected());
});

afterEach(() => {
  document.body.replaceChildren();
  vi.useRealTimers();
  vi.restoreAllMocks();
});

async function show(attributes: string): Promise<TigasViewer> {
  document.body.innerHTML = `<tigas-viewer ${attributes}></tigas-viewer>`;
  const element = document.querySelector("tigas-viewer");
  if (!element) throw new Error("there is no element");
  await settle();
  return element;
}

function inside<Found extends HTMLElement>(element: TigasViewer, selector: string): Found {
  const found = element.shadowRoot?.querySelector<Found>(selector);
  if (!found) throw new Error(`there is no ${selector}`);
  return found;
}

function listen<Detail>(element: TigasViewer, name: string, hear: (detail: Detail) => void): void {
  element.addEventListener(name, (event) => hear((event as CustomEvent<Detail>).detail));
}

const visible = (element: HTMLElement) => !element.hidden;

test("shows a scene of a server from the pose in the attribute, after its thumbnail", async () => {
  const element = await show(`src="https://lab.test/" scene="my garden" at="${AT}"`);
  const poster = inside<HTMLImageElement>(element, ".poster");
  expect([visible(poster), poster.src]).toEqual([true, "https://lab.test/scenes/my%20garden/preview"]);
  const told: string[] = [];
  for (const name of ["loaded", "frame", "stats", "error"]) element.addEventListener(name, () => told.push(name));
  await host.frames(30);
  expect(vi.mocked(loadScene).mock.calls[0]?.[2]?.server).toBe("https://lab.test");
  expect(host.requests().at(-1)).toMatchObject({ scene: "my garden", position: [1, -2, 3] });
  expect(visible(poster)).toBe(false);
  expect(new Set(told)).toEqual(new Set(["frame", "stats"]));
});

test("reports the scene, and an error with its code", async () => {
  vi.mocked(loadScene).mockRejectedValue(new ApiError("There is no scene attic.", false));
  document.body.innerHTML = "<tigas-viewer></tigas-viewer>";
  const element = document.querySelector("tigas-viewer") as TigasViewer;
  const told: unknown[] = [];
  listen<ViewerEvents["error"]>(element, "error", (error) => told.push(error));
  listen<ViewerEvents["loaded"]>(element, "loaded", ({ id }) => told.push(id));
  element.setAttribute("scene", "attic");
  await settle();
  expect(told).toEqual([{ code: "failed", message: "There is no scene attic." }]);
  expect(inside(element, ".message")).toMatchObject({ hidden: false, textContent: "There is no scene attic." });
  vi.mocked(loadScene).mockResolvedValue(COURTYARD);
  element.setAttribute("scene", "courtyard");
  await settle();
  await host.frames(1);
  expect(told.at(-1)).toBe("courtyard");
  expect(visible(inside(element, ".message"))).toBe(false);
});

test("follows its attributes, and says which one makes no sense", async () => {
  const element = await show('scene="garden"');
  await host.frames(5);
  expect(element.viewer?.settings).toMatchObject({ mode: "stateless", controller: "seen" });
  element.setAttribute("quality", "2");
  element.setAttribute("at", AT);
  await host.frames(5);
  expect(element.viewer?.settings).toMatchObject({ controller: "fixed", profile: 2 });
  expect(element.viewer?.camera.position).toEqual([1, -2, 3]);
  expect(host.requests().at(-1)).toMatchObject({ position: [1, -2, 3], profile: 2 });

  element.viewer?.set({ mode: "video", profile: 1 });
  element.setAttribute("at", "0,0,0,0,0,0,1");
  expect(element.viewer?.settings).toMatchObject({ mode: "video", profile: 1 });
  element.setAttribute("mode", "stateless");
  expect(element.viewer?.settings).toMatchObject({ mode: "stateless", profile: 1 });

  const invalid = vi.fn();
  listen(element, "error", invalid);
  element.setAttribute("mode", "magic");
  expect(invalid).toHaveBeenLastCalledWith({ code: "invalid", message: expect.stringContaining("“magic”") });
  await host.frames(5);
  expect(inside(element, ".message").textContent).toContain("“magic”");
  element.removeAttribute("mode");
  expect(visible(inside(element, ".message"))).toBe(false);
  element.setAttribute("at", "somewhere");
  expect(invalid).toHaveBeenLastCalledWith({ code: "invalid", message: expect.stringContaining("“somewhere”") });
  element.setAttribute("mode", "video");
  expect(element.viewer?.settings.mode, "an attribute does not wait for another that is wrong").toBe("video");
  expect(inside(element, ".message").textContent).toContain("“somewhere”");
});

test("takes its message back once the server is there again, also where the picture needs no frame", async () => {
  const element = await show('scene="garden"');
  await host.frames(5);
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
  const message = inside(element, ".message");
  host.transports[0]?.lose("The connection broke.");
  await vi.advanceTimersByTimeAsync(0);
  expect([visible(message), message.textContent]).toEqual([true, "The connection broke."]);
  await vi.advanceTimersByTimeAsync(5000);
  expect(host.transports).toHaveLength(2);
  expect(visible(message)).toBe(false);
});

test.each(["https://[", "localhost:8080"])(
  "the server %s is refused with a sentence, until another is named",
  async (src) => {
    const element = await show("");
    const told = vi.fn();
    listen(element, "error", told);
    element.setAttribute("src", src);
    element.setAttribute("scene", "garden");
    await settle();
    const message = `“${src}” is not a server's URL: use one such as https://viewer.example.`;
    expect(told.mock.calls).toEqual([[{ code: "invalid", message }]]);
    element.setAttribute("mode", "video");
    expect([element.viewer, inside(element, ".message").textContent]).toEqual([null, message]);
    element.setAttribute("src", "https://lab.test");
    await settle();
    expect(element.viewer?.settings.mode).toBe("video");
    expect(visible(inside(element, ".message"))).toBe(false);
  },
);

test("an element that is moved, or is back after its removal, shows its scene in one visit", async () => {
  const element = await show('scene="garden"');
  await host.frames(5);
  const place = document.createElement("section");
  document.body.append(place);
  place.append(element);
  await settle();
  element.setAttribute("scene", "hall");
  element.remove();
  document.body.append(element);
  await settle();
  await host.frames(5);
  expect(host.transports.filter(({ closed }) => !closed)).toEqual([host.transports.at(-1)]);
  expect(host.animationFrames.size).toBe(1);
  expect(element.shadowRoot?.querySelectorAll(".view > *")).toHaveLength(1);
  expect(host.transports.at(-1)?.requests[0]?.request.scene).toBe("hall");
});

test("another scene replaces the first one", async () => {
  const element = await show('scene="garden"');
  await host.frames(5);
  const { viewer } = element;
  element.setAttribute("src", "https://lab.test");
  element.setAttribute("scene", "hall");
  await settle();
  const before = host.requests().length;
  await host.frames(5);
  expect(element.viewer).not.toBe(viewer);
  expect(
    new Set(
      host
        .requests()
        .slice(before)
        .map(({ scene }) => scene),
    ),
  ).toEqual(new Set(["hall"]));
  expect(new Set(vi.mocked(loadScene).mock.calls.map(([scene]) => scene))).toEqual(new Set(["garden", "hall"]));
});

test("ends with its removal", async () => {
  const element = await show('scene="garden"');
  await host.frames(5);
  const asked = host.requests().length;
  element.remove();
  expect(element.viewer).toBeNull();
  expect(host.animationFrames.size).toBe(0);
  await host.frames(5);
  expect(host.requests()).toHaveLength(asked);
});

test("has buttons only with the attribute controls", async () => {
  const element = await show('scene="garden"');
  await host.frames(5);
  const bar = inside(element, ".toolbar");
  expect(visible(bar)).toBe(false);
  element.setAttribute("controls", "");
  expect(visible(bar)).toBe(true);
  element.setAttribute("at", AT);
  await host.frames(2);
  inside(element, "[aria-label='Back to the start']").click();
  await host.frames(2);
  expect(element.viewer?.camera.position).toEqual([0, -2, -8]);
});
