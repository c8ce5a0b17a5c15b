import { beforeEach, describe, expect, test, vi } from "vitest";
import { FakeDevice as Device, type FakeDevice, FakeRenderer, fakeModel, PLACE } from "#fakes/gpu";
import { settle } from "#fakes/transport";
import { Chain } from "./chain";
import { Display } from "./display";
import type { Active, Enhancement } from "./enhancement";
import type { Overlay } from "./overlay";
import type { Renderer } from "./renderer";

interface Frame {
  readonly id: number;
  readonly bitmap: ImageBitmap & { closed: boolean };
  readonly header: { readonly profile: number; readonly margin_x?: number; readonly margin_y?: number };
}

/** Enhancement controlled by the test. */
class FakeEnhancement {
  active: Active | null = null;
  said: string | null = null;
  onChange: () => void = () => undefined;
  seen(): void {}
  renew(): void {}

  giveUp(message: string): void {
    this.said = message;
    this.set(null);
  }

  set(active: Active | null): void {
    this.active = active;
    this.onChange();
  }
}

let device: FakeDevice;
let canvas: { drawn: unknown[]; style: { scale?: string } };
let overlay: { shows: boolean; canvas: { style: { scale?: string } } };
let enhancement: FakeEnhancement;
let renderer: FakeRenderer;
let size: { width: number; height: number };
let now: number;
let ids: number;
let display: Display<Frame>;

beforeEach(() => {
  vi.stubGlobal("GPUTextureUsage", {});
  vi.stubGlobal("createImageBitmap", async () => bitmap());
  device = new Device();
  canvas = { drawn: [], style: {} };
  overlay = { shows: false, canvas: { style: {} } };
  enhancement = new FakeEnhancement();
  renderer = new FakeRenderer();
  size = { width: 1280, height: 720 };
  now = 0;
  ids = 0;
  display = new Display<Frame>({
    canvas: {
      style: canvas.style,
      getContext: () => ({
        transferFromImageBitmap: (drawn: Frame["bitmap"] | null) => {
          canvas.drawn.push(drawn);
          if (drawn) Object.assign(drawn, { width: 0, height: 0 }); // its pixels are the canvas's
        },
      }),
    } as unknown as HTMLCanvasElement,
    overlay: {
      canvas: overlay.canvas,
      show: () => {
        overlay.shows = true;
      },
      hide: () => {
        overlay.shows = false;
      },
    } as unknown as Overlay,
    enhancement: enhancement as unknown as Enhancement,
    size: () => size,
  });
});

function bitmap(): Frame["bitmap"] {
  const made = {
    width: 320,
    height: 180,
    closed: false,
    close: () => Object.assign(made, { width: 0, height: 0, closed: true }),
  };
  return made as unknown as Frame["bitmap"];
}

function frame(): Frame {
  ids++;
  return { id: ids, bitmap: bitmap(), header: { profile: 3 } };
}

async function on(name = "a", run?: Parameters<typeof fakeModel>[2]): Promise<void> {
  const models = [fakeModel(name, {}, run)];
  const chain = await Chain.load(device as unknown as GPUDevice, models, PLACE, new AbortController().signal);
  enhancement.set({ renderer: renderer as unknown as Renderer, chain });
}

/** Completes the GPU's work on this frame. */
async function done(index: number, ms = 2): Promise<void> {
  renderer.frames.at(index)?.done.resolve(ms);
  await settle();
}

/** Runs one animation frame; returns the id of the frame that has newly appeared on the screen. */
function animationFrame(): number | undefined {
  now += 1000 / 60;
  return display.presented(now)?.frame.id;
}

test("without a model a frame goes to the canvas, and is on the screen in the next animation frame", () => {
  const first = frame();
  display.show(first);
  expect(canvas.drawn).toEqual([first.bitmap]);
  expect([animationFrame(), animationFrame()]).toEqual([1, undefined]);
  expect(overlay.shows).toBe(false);
});

test("a picture's margins lie beyond the pane, and those of a picture that is to replace it do not matter yet", async () => {
  const wide = (margin_x: number, margin_y: number) => ({ ...frame(), header: { profile: 3, margin_x, margin_y } });
  display.show(wide(40, 20));
  expect(canvas.style.scale).toBe(`${320 / 240} ${180 / 140}`);
  display.show(frame());
  expect(canvas.style.scale).toBe("1 1");
  await on();
  display.show(wide(40, 20));
  display.show(frame());
  await done(0);
  animationFrame();
  expect(overlay.canvas.style.scale).toBe(`${320 / 240} ${180 / 140}`);
});

describe("with a model", () => {
  beforeEach(() => on());

  test("a frame is on the screen when the graphics processor has done it, at the displayed size", async () => {
    display.show(frame());
    expect(display.settled).toBe(false);
    expect([animationFrame(), animationFrame()]).toEqual([undefined, undefined]);
    await done(0, 3);
    const told = display.presented(now);
    expect(told).toMatchObject({
      frame: { id: 1 },
      enhanced: { width: 1280, height: 720, ms: 3, restore: "off", upscale: "a" },
    });
    expect(told?.enhanced?.copy()).toMatchObject({ width: 1280 });
    expect([display.settled, overlay.shows, canvas.drawn]).toEqual([true, true, []]);
  });

  test("no more than two are in the making, so that the newest waits where it can be overtaken", async () => {
    display.show(frame());
    expect(display.ready).toBe(true);
    display.show(frame());
    expect(display.ready).toBe(false);
    await done(0);
    expect([animationFrame(), display.ready]).toEqual([1, true]);
  });

  test("of two that are done at once the newer one was seen, and what is shown can be copied until then", async () => {
    display.show(frame());
    await done(0);
    const shown = display.presented(now);
    display.show(frame());
    display.show(frame());
    await done(1);
    await done(2);
    expect(shown?.enhanced?.copy()).toBeTruthy();
    expect(animationFrame()).toBe(3);
    expect(() => shown?.enhanced?.copy()).toThrow("released");
  });

  test("bitmaps are closed when a newer one is there", async () => {
    const [first, second] = [frame(), frame()];
    display.show(first);
    display.show(second);
    expect([first.bitmap.closed, second.bitmap.closed]).toEqual([true, false]);
    display.dispose();
    expect(second.bitmap.closed).toBe(true);
  });

  test("another model takes over between two frames, and none is lost", async () => {
    const told: (number | undefined)[] = [];
    for (let i = 0; i < 6; i++) {
      if (i === 3) await on("b");
      display.show(frame());
      await done(-1);
      told.push(animationFrame());
    }
    expect(told).toEqual([1, 2, 3, 4, 5, 6]);
    expect(renderer.frames.map(({ label }) => label)).toEqual(["A", "A", "A", "B", "B", "B"]);
  });

  test("another model enhances the picture of a camera that stands still, too, which is no new frame", async () => {
    display.show(frame());
    await done(0);
    animationFrame();
    await on("b");
    expect(animationFrame()).toBeUndefined();
    await done(1);
    expect([renderer.frames.at(-1)?.label, animationFrame()]).toEqual(["B", undefined]);
  });

  test("switched off, the frame on the screen is shown as it came", async () => {
    const only = frame();
    display.show(only);
    await done(0);
    animationFrame();
    enhancement.set(null);
    expect([canvas.drawn, overlay.shows, animationFrame()]).toEqual([[only.bitmap], false, undefined]);
  });

  test("when the device is lost the frame that it had is shown as it came, and told of", () => {
    const only = frame();
    display.show(only);
    enhancement.set(null);
    expect([canvas.drawn, animationFrame(), display.settled]).toEqual([[only.bitmap], 1, true]);
  });

  test("a model that takes too long is switched off, in the animation frame after the one that shows it", async () => {
    for (let i = 0; i < 5; i++) {
      display.show(frame());
      await done(-1, 300);
      now += 1000 / 60;
      const told = display.presented(now);
      expect(told?.enhanced?.copy()).toBeTruthy();
    }
    expect(enhancement.said).toBeNull();
    animationFrame();
    expect(enhancement.said).toBe("It took 300 ms per frame, but the display shows one every 17 ms.");
  });

  test("a graphics processor that is never done is given up", () => {
    display.show(frame());
    for (let i = 0; i < 70; i++) animationFrame();
    expect(enhancement.said).toBe("The graphics processor is too slow.");
    expect(canvas.drawn).toHaveLength(1);
  });

  test("a page that was hidden for minutes goes on where it was", async () => {
    for (let i = 0; i < 40; i++) animationFrame();
    display.show(frame());
    now += 600_000; // hidden pages get no animation frames
    await done(0);
    expect([animationFrame(), display.ready, enhancement.said]).toEqual([1, true, null]);
    for (let i = 0; i < 20; i++) {
      display.show(frame());
      await done(-1, 15);
      animationFrame();
    }
    expect(enhancement.said).toBeNull();
  });

  test("a stage without size shows frames as they come", () => {
    size = { width: 0, height: 0 };
    display.show(frame());
    expect([canvas.drawn.length, animationFrame()]).toEqual([1, 1]);
  });

  test("frames that another mode makes worthless are not told of", async () => {
    display.show(frame());
    display.forget();
    await done(0);
    expect(animationFrame()).toBeUndefined();
  });
});

test("a model that throws is given up, and its frame is shown as it came", async () => {
  await on("a", () => {
    throw new Error("no such format");
  });
  display.show(frame());
  expect(enhancement.said).toBe("A failed: no such format.");
  expect([canvas.drawn.length, animationFrame()]).toEqual([1, 1]);
});

test("a model that is switched on enhances the picture of a camera that stands still", async () => {
  display.show(frame());
  animationFrame();
  await on();
  animationFrame();
  await settle();
  expect(renderer.frames).toHaveLength(1);
  await done(0);
  expect(animationFrame()).toBeUndefined();
  expect(overlay.shows).toBe(true);
});
