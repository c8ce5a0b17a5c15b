import { expect, test, vi } from "vitest";
import { COURTYARD, serverConfig } from "#fakes/server";
import { defaultIntrinsics } from "../view/intrinsics";
import { screenshot } from "./screenshot";

const VIEWPORT = { width: 1000, height: 500 };

const holding = <T>(value: T) => ({ peek: () => value }) as never;

function visit({ loaded = true } = {}): Parameters<typeof screenshot>[0] {
  return {
    rig: {
      viewport: holding(VIEWPORT),
      intrinsics: holding(defaultIntrinsics(VIEWPORT)),
      pose: { seq: 7, position: [1, 2, 3], quaternion: [0, 0, 0, 1] },
    } as never,
    scene: holding(loaded ? COURTYARD : null),
    state: { config: holding({ ...serverConfig(), render_url: "https://lab.test" }) } as never,
    pixelRatio: holding(2),
  };
}

function server(answer: () => Response) {
  const fetch = vi.fn<(url: string, init: RequestInit) => Promise<Response>>(async () => answer());
  vi.stubGlobal("fetch", fetch);
  vi.stubGlobal("location", { href: "https://page.test/" });
  return () => JSON.parse(String(fetch.mock.lastCall?.[1].body));
}

const png = () =>
  new Response("png", { headers: { "Content-Type": "image/png", "Tigas-Frame": "seq=0, width=1, height=1" } });

test("asks the server for the view in the screen's pixels, without a profile", async () => {
  const asked = server(png);
  const picture = await screenshot(visit());
  expect([picture.type, await picture.text()]).toEqual(["image/png", "png"]);
  expect(fetch).toHaveBeenCalledWith("https://lab.test/render", expect.anything());
  expect(asked()).toMatchObject({ scene: "courtyard", position: [1, 2, 3], format: "png", width: 2000, height: 1000 });
  expect(asked()).not.toHaveProperty("profile");
});

test.each([
  [{ width: 500 }, { width: 500, height: 250 }],
  [{ height: 1000 }, { width: 2000, height: 1000 }],
  [
    { width: 3840, height: 2160 },
    { width: 3840, height: 2160, cx: 1920, cy: 1080 },
  ],
])("%j shows as much from top to bottom", async (size, expected) => {
  const asked = server(png);
  await screenshot(visit(), size);
  expect(asked()).toMatchObject(expected);
  const { fy } = defaultIntrinsics(VIEWPORT);
  expect(asked().height / asked().fy).toBeCloseTo(VIEWPORT.height / fy);
  expect(asked().fx).toBe(asked().fy);
});

test("waits while the server draws for moving viewers", async () => {
  vi.useFakeTimers();
  const busy = { type: "tigas:overloaded", title: "", status: 503, detail: "Other viewers wait." };
  const answers = [Response.json(busy, { status: 503 }), png()];
  server(() => answers.shift() ?? png());
  const taken = screenshot(visit());
  await vi.advanceTimersByTimeAsync(3000);
  expect((await taken).type).toBe("image/png");
  vi.useRealTimers();
});

test("says why there is none", async () => {
  const problem = { type: "tigas:invalid-request", title: "", status: 422, detail: "The picture is too large." };
  server(() => Response.json(problem, { status: 422 }));
  await expect(screenshot(visit(), { width: 99_999 })).rejects.toThrow("The picture is too large.");
  await expect(screenshot(visit({ loaded: false }))).rejects.toThrow("not loaded");
});
