import { beforeEach, expect, test, vi } from "vitest";
import { VideoFile } from "../export/video-file";
import { camera } from "./screenshot";
import { exportVideo } from "./video-export";

vi.mock("../export/video-file", () => ({ VideoFile: { open: vi.fn() } }));
vi.mock("./screenshot", async (original) => ({ ...(await original<object>()), camera: vi.fn() }));

const VISIT = { rig: { viewport: { peek: () => ({ width: 641, height: 360 }) } } } as never;
/** A second along the x axis. */
const PATH = {
  duration: 1000,
  at: (time: number) => ({ position: [time, 0, 0], quaternion: [0, 0, 0, 1] }) as never,
};

let file: { add: ReturnType<typeof vi.fn>; finish: ReturnType<typeof vi.fn>; cancel: ReturnType<typeof vi.fn> };
let take: ReturnType<typeof vi.fn>;

beforeEach(() => {
  file = { add: vi.fn(async () => undefined), finish: vi.fn(async () => new Blob(["mp4"])), cancel: vi.fn() };
  take = vi.fn(async ({ position }) => `picture at ${position[0]}`);
  vi.mocked(VideoFile.open).mockResolvedValue(file as never);
  vi.mocked(camera).mockReturnValue(take as never);
  vi.stubGlobal("createImageBitmap", async (png: string) => png);
});

test("takes a picture for each frame of the path, in the view's size with even sides", async () => {
  const shares: number[] = [];
  const video = await exportVideo(VISIT, PATH, { framesPerSecond: 4, onProgress: (share) => shares.push(share) });
  expect(await video.text()).toBe("mp4");
  expect(VideoFile.open).toHaveBeenCalledWith({ width: 640, height: 360, framesPerSecond: 4 });
  expect(file.add.mock.calls.flat()).toEqual([0, 250, 500, 750, 1000].map((time) => `picture at ${time}`));
  expect(shares).toEqual([0.2, 0.4, 0.6, 0.8, 1]);
});

test("a cancelled video asks for no more pictures and leaves no file", async () => {
  const stop = new AbortController();
  const made = exportVideo(VISIT, PATH, { signal: stop.signal, onProgress: () => stop.abort(new Error("cancelled")) });
  await expect(made).rejects.toThrow("cancelled");
  expect(take).toHaveBeenCalledTimes(1);
  expect([file.cancel, file.finish].map(({ mock }) => mock.calls.length)).toEqual([1, 0]);
});

test("a server that refuses a picture ends it with its reason", async () => {
  take.mockRejectedValue(new Error("The server is full."));
  await expect(exportVideo(VISIT, PATH)).rejects.toThrow("The server is full.");
  expect(file.cancel).toHaveBeenCalled();
});
