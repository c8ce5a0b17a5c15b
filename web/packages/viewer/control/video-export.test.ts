import { BufferTarget, getFirstEncodableVideoCodec, Output } from "mediabunny";
import { beforeEach, expect, test, vi } from "vitest";
import { camera } from "./screenshot";
import { exportVideo } from "./video-export";

vi.mock("mediabunny");
vi.mock("./screenshot", async (original) => ({ ...(await original<object>()), camera: vi.fn() }));

const VISIT = { rig: { viewport: { peek: () => ({ width: 641, height: 360 }) } } } as never;
/** A movement of one second along the x axis. */
const PATH = {
  duration: 1000,
  at: (time: number) => ({ position: [time, 0, 0], quaternion: [0, 0, 0, 1] }) as never,
};

const drawImage = vi.fn();
class FakeCanvas {
  getContext = () => ({ drawImage });
}
let take: ReturnType<typeof vi.fn>;

beforeEach(() => {
  vi.clearAllMocks();
  take = vi.fn(async ({ position }) => ({ time: position[0], close: vi.fn() }));
  vi.mocked(camera).mockReturnValue(take as never);
  BufferTarget.prototype.buffer = new TextEncoder().encode("mp4").buffer;
  vi.mocked(getFirstEncodableVideoCodec).mockResolvedValue("avc");
  vi.stubGlobal("createImageBitmap", async (png: unknown) => png);
  vi.stubGlobal("OffscreenCanvas", FakeCanvas);
});

test("takes a picture for each frame of the path, in the view's size with even sides", async () => {
  const shares: number[] = [];
  const video = await exportVideo(VISIT, PATH, { framesPerSecond: 4, onProgress: (share) => shares.push(share) });
  expect(await video.text()).toBe("mp4");
  expect(Output.prototype.addVideoTrack).toHaveBeenCalledWith(expect.anything(), { frameRate: 4 });
  const drawn = drawImage.mock.calls.map(([picture, ...to]) => [picture.time, picture.close.mock.calls.length, ...to]);
  expect(drawn).toEqual([0, 250, 500, 750, 1000].map((time) => [time, 1, 0, 0, 640, 360]));
  expect(shares).toEqual([0.2, 0.4, 0.6, 0.8, 1]);
});

test("a cancelled video asks for no more pictures and leaves no file", async () => {
  const stop = new AbortController();
  const made = exportVideo(VISIT, PATH, { signal: stop.signal, onProgress: () => stop.abort(new Error("cancelled")) });
  await expect(made).rejects.toThrow("cancelled");
  expect(take).toHaveBeenCalledTimes(1);
  expect(Output.prototype.cancel).toHaveBeenCalledTimes(1);
  expect(Output.prototype.finalize).not.toHaveBeenCalled();
});

test("a server that refuses a picture ends it with its reason", async () => {
  take.mockRejectedValue(new Error("The server is full."));
  await expect(exportVideo(VISIT, PATH)).rejects.toThrow("The server is full.");
  expect(Output.prototype.cancel).toHaveBeenCalled();
});
