import { beforeAll, beforeEach, expect, test, vi } from "vitest";
import { deferred } from "#client/async/deferred";
import { FakeDevice, type FakeRenderer, fakeModel, NO_WORK, PLACE } from "#fakes/gpu";
import { turn as settle } from "#fakes/transport";
import { Enhancement } from "./enhancement";
import { EnhancementError, type Enhancer } from "./model/enhancer";
import type { Overlay } from "./overlay";

vi.mock("./renderer", async () => ({ Renderer: (await import("#fakes/gpu")).FakeRenderer }));

let devices: FakeDevice[];
let changes: (string | null)[];
let open: () => Promise<GPUDevice>;
let subject: Enhancement;

beforeAll(() => Promise.all([import("./chain"), import("./renderer")]));

beforeEach(() => {
  vi.stubGlobal("GPUTextureUsage", {});
  devices = [];
  changes = [];
  open = async () => {
    devices.push(new FakeDevice());
    return devices.at(-1) as unknown as GPUDevice;
  };
  subject = new Enhancement({ overlay: { canvas: {} } as Overlay, open: () => open() });
  subject.onChange = () => changes.push(subject.active?.chain.label ?? null);
});

const status = () => subject.status.value;

async function chosen(...models: Enhancer[]): Promise<void> {
  subject.choose(models, PLACE);
  await settle();
}

test("nothing is asked for before a model is chosen", async () => {
  await settle();
  expect(devices).toHaveLength(0);
  expect(status()).toEqual({ kind: "off" });
});

test("models are loaded together, and enhance when all are ready", async () => {
  const loading = deferred<null>();
  const slow = fakeModel("b", { load: () => loading.promise.then(() => NO_WORK) });
  await chosen(fakeModel("a", { kind: "restore" }), slow);
  expect(status()).toEqual({ kind: "starting", message: null });
  expect(subject.active).toBeNull();
  loading.resolve(null);
  await settle();
  expect(status()).toEqual({ kind: "on", labels: PLACE.ladder.map(() => "A + B") });
  expect(subject.active?.chain.names(0)).toEqual({ restore: "a", upscale: "b" });
});

test("of each rung it tells the models that change its frames", async () => {
  const low = fakeModel("low", { load: () => Promise.resolve({ ...NO_WORK, serves: (rung: number) => rung > 0 }) });
  await chosen(fakeModel("a", { kind: "restore" }), low);
  const [, ...others] = PLACE.ladder;
  expect(status()).toEqual({ kind: "on", labels: ["A", ...others.map(() => "A + LOW")] });
  const named = [0, 1, null].map((rung) => subject.active?.chain.names(rung).upscale);
  expect(named, "as records name them").toEqual(["off", "low", "off"]);
});

test("another model takes over when it is ready, on the same device, and the former goes on until then", async () => {
  const former = fakeModel("former");
  await chosen(former);
  const loading = deferred<null>();
  subject.seen({ width: 64, height: 36, rung: 3 });
  await chosen(fakeModel("next", { load: () => loading.promise.then(() => NO_WORK) }));
  expect(subject.active?.chain.label).toBe("FORMER");
  expect(former.disposed).toBe(0);
  loading.resolve(null);
  await settle();
  expect(changes).toEqual(["FORMER", "NEXT"]);
  expect(former.disposed).toBe(1);
  expect(devices).toHaveLength(1);
  const renderer = subject.active?.renderer as unknown as FakeRenderer;
  expect(renderer.warm, "it had compiled its shaders for the frames that come").toEqual([
    { width: 64, height: 36, rung: 3 },
  ]);
});

test("of several choices the last one counts", async () => {
  const loading = deferred<null>();
  const slow = fakeModel("slow", { load: () => loading.promise.then(() => NO_WORK) });
  void chosen(slow);
  await chosen(fakeModel("quick"));
  loading.resolve(null);
  await settle();
  expect(changes).toEqual(["QUICK"]);
});

test("switched off, nothing remains", async () => {
  const model = fakeModel("a");
  await chosen(model);
  subject.off();
  await settle();
  expect(changes).toEqual(["A", null]);
  expect([model.disposed, devices[0]?.destroyed, status().kind]).toEqual([1, true, "off"]);
});

test.each<[string, Partial<Enhancer>, string]>([
  ["has no weights for the scene", { weights: () => null }, "X cannot be used: there are no weights for this scene."],
  [
    "is given broken weights",
    { load: () => Promise.reject(new EnhancementError("its file ends too early.")) },
    "X cannot be used: its file ends too early.",
  ],
  ["throws while it is loaded", { load: () => Promise.reject(new Error("oops")) }, "X cannot be used: oops."],
])("a model that %s is told of in a sentence", async (_, part, sentence) => {
  const other = fakeModel("fine", { kind: "restore" });
  await chosen(other, fakeModel("x", part));
  expect(status()).toEqual({ kind: "failed", message: sentence });
  expect(subject.active).toBeNull();
  expect(other.disposed, "what was loaded beside it").toBe(1);
});

test.each([
  [
    "a server's refusal",
    () => Response.json({ type: "x", detail: "There are none." }, { status: 404 }),
    "There are none.",
  ],
  ["no answer", () => Promise.reject(new TypeError("Failed to fetch")), "its weights could not be loaded."],
])("weights that fail to load are told of: %s", async (_, answer, sentence) => {
  vi.stubGlobal("fetch", async () => answer());
  await chosen(fakeModel("x", { weights: () => "scenes/courtyard/enhance.safetensors" }));
  expect(status()).toMatchObject({ kind: "failed", message: expect.stringContaining(sentence) });
});

test("weights come from the scene's server", async () => {
  vi.stubGlobal("location", { href: "https://page.test/" });
  const fetched = vi.fn(async () => new Response());
  vi.stubGlobal("fetch", fetched);
  const models = [fakeModel("x", { weights: () => "scenes/courtyard/enhance.safetensors" })];
  subject.choose(models, { ...PLACE, host: { render_url: "https://lab.test" } });
  await settle();
  expect(fetched).toHaveBeenCalledWith("https://lab.test/scenes/courtyard/enhance.safetensors", expect.anything());
});

test("a model that throws on the first picture is never shown", async () => {
  subject.seen({ width: 64, height: 36, rung: 3 });
  const model = fakeModel("x", {}, () => {
    throw new Error("no such format");
  });
  await chosen(model);
  expect(status()).toEqual({ kind: "failed", message: "X failed: no such format." });
  expect([changes, model.disposed]).toEqual([[], 1]);
});

test("without WebGPU it says so", async () => {
  open = () => Promise.reject(new EnhancementError("This browser has no WebGPU."));
  await chosen(fakeModel("a"));
  expect(status()).toEqual({ kind: "failed", message: "This browser has no WebGPU." });
  open = async () => new FakeDevice() as unknown as GPUDevice;
  await chosen(fakeModel("a"));
  expect(status().kind).toBe("on");
});

test("a device that is lost is asked for once more, and then again only when a person chooses", async () => {
  await chosen(fakeModel("a"));
  const retried = deferred<GPUDevice>();
  open = () => retried.promise;
  devices[0]?.lose();
  await settle();
  expect(status()).toEqual({ kind: "starting", message: "The graphics processor was lost; restarting." });
  expect(changes).toEqual(["A", null]);
  const second = new FakeDevice();
  retried.resolve(second as unknown as GPUDevice);
  await settle();
  expect(changes).toEqual(["A", null, "A"]);
  second.lose();
  await settle();
  expect(status()).toEqual({ kind: "failed", message: "The graphics processor was lost again." });
  open = async () => new FakeDevice() as unknown as GPUDevice;
  await chosen(fakeModel("a"));
  expect(status().kind).toBe("on");
});

test("an error of the device's own gives the models up, and those of a former device do not", async () => {
  await chosen(fakeModel("a"));
  devices[0]?.complain("Out of memory.\n - While encoding.");
  await settle();
  expect(status()).toEqual({ kind: "failed", message: "A failed: Out of memory." });
  await chosen(fakeModel("b"));
  devices[0]?.complain("Late.");
  expect(status()).toEqual({ kind: "on", labels: PLACE.ladder.map(() => "B") });
});

test("what is left while the device is opened stays off", async () => {
  const opening = deferred<GPUDevice>();
  open = () => opening.promise;
  void chosen(fakeModel("a"));
  subject.off();
  const device = new FakeDevice();
  opening.resolve(device as unknown as GPUDevice);
  await settle();
  expect([status().kind, device.destroyed, changes]).toEqual(["off", true, []]);
});
