import { beforeEach, expect, test, vi } from "vitest";
import { deferred } from "#client/async/deferred";
import { STILL, steeredRig } from "#fakes/rig";
import type { NumberedPose, Rig } from "../view/rig";
import { MovementError } from "./movement";
import { addFile, MovementDeck, movements, type NamedMovement, unsaved } from "./movement-deck";
import { readMovement, writeMovement } from "./movement-file";

const WALK = readMovement("t_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n100,1,0,0,0,0,0,1\n300,2,0,0,0,0,0,1\n");

let axes: typeof STILL;
let rig: Rig;
let deck: MovementDeck;

beforeEach(() => {
  vi.setSystemTime("2026-01-02T03:04:05Z");
  movements.value = [];
  unsaved.value = new Set();
  axes = STILL;
  rig = steeredRig(() => axes);
  rig.sample(0);
  deck = new MovementDeck(rig);
  deck.insert(addFile("walk.csv", WALK));
});

/** The camera's position along x at a time. */
const x = (now: number): number => {
  rig.sample(now);
  return rig.pose.position[0];
};

test("a movement follows its own stamps from the first frame that shows it", () => {
  deck.play();
  expect([x(5000), x(5050), x(5100), x(5200), x(5300)]).toEqual([0, 0.5, 1, 1.5, 2]);
  expect(deck.position.value).toBe(300);
});

test("the person's input waits while it plays, and at its end goes on from there", () => {
  axes = { ...STILL, right: 1 };
  deck.play();
  expect([x(0), x(300)]).toEqual([0, 2]);
  expect(deck.state.value).toBe("playing");
  expect(x(316)).toBeGreaterThan(2);
  expect(deck.state.value).toBe("stopped");
  expect(deck.position.value).toBe(300);
  deck.play();
  expect(x(400)).toBe(0);
});

test("paused it stays, sought it jumps, and it goes on", () => {
  deck.play();
  x(0);
  x(50);
  deck.pause();
  expect(x(900)).toBe(0.5);
  deck.seek(200);
  expect(x(1000)).toBe(1.5);
  deck.play();
  expect(x(1050)).toBe(1.75);
  deck.seek(-10);
  expect(x(1050)).toBe(0);
  deck.seek(1e9);
  expect(x(1050)).toBe(2);
});

test("sought while it is stopped, it shows that moment", () => {
  deck.seek(100);
  expect(deck.state.value).toBe("paused");
  expect(x(10)).toBe(1);
});

test("stopped, the person goes on from there, and it plays from its start", () => {
  deck.play();
  x(0);
  x(100);
  deck.stop();
  axes = { ...STILL, right: 1 };
  expect(x(116)).toBeGreaterThan(1);
  expect(deck.position.value).toBe(0);
  deck.play();
  expect(x(200)).toBe(0);
});

test("begun again and again if that is wished, a single pose, too", () => {
  deck.loop.value = true;
  deck.play();
  expect([x(0), x(250), x(350), x(400)]).toEqual([0, 1.75, 0.5, 1]);
  deck.insert(addFile("stand.csv", readMovement("t_ms,x,y,z,qx,qy,qz,qw\n7,5,0,0,0,0,0,1\n")));
  deck.play();
  expect([x(500), x(600), x(700)]).toEqual([5, 5, 5]);
  expect(deck.state.value).toBe("playing");
  deck.loop.value = false;
  expect(x(800)).toBe(5);
  expect(deck.state.value).toBe("stopped");
});

test("what cannot be had changes nothing", async () => {
  deck.play();
  x(0);
  await deck.open(() => Promise.reject(new MovementError("walk.csv is empty.")));
  expect(deck.problem.value).toBe("walk.csv is empty.");
  expect([x(100), deck.state.value, deck.movement.value?.name]).toEqual([1, "playing", "walk.csv"]);
});

test("what was asked for last is inserted, whichever comes first", async () => {
  const late = deferred<NamedMovement>();
  const opening = deck.open(() => late.promise);
  await deck.open(() => Promise.resolve(addFile("b.csv", WALK)));
  late.resolve(addFile("a.csv", WALK));
  await opening;
  expect(deck.movement.value?.name).toBe("b.csv");
});

test("a script that takes the camera ends it, and is not disturbed", () => {
  deck.play();
  x(0);
  rig.drive(() => ({ position: [9, 0, 0], quaternion: [0, 0, 0, 1] }));
  expect(deck.state.value).toBe("stopped");
  expect(deck.busy.value).toBe(true);
  deck.play();
  deck.seek(50);
  expect(x(16)).toBe(9);
});

test("what is recorded plays as it was seen, standing still included", () => {
  const seen: NumberedPose[] = [];
  deck.record();
  const times = [1000, 1016.7, 1033.4, 1050, 1400, 1416];
  for (const [i, at] of times.entries()) {
    axes = i % 3 === 0 ? STILL : { ...STILL, forward: 1, turnRight: 1, turnUp: -0.4 };
    rig.sample(at);
    seen.push(rig.pose);
  }
  deck.play(); // one thing at a time
  expect(deck.state.value).toBe("recording");
  deck.stop();
  const recording = deck.movement.value;
  expect(recording).toMatchObject({ name: "Recording 1", origin: "recording" });
  expect([...unsaved.value]).toEqual([recording]);
  if (!recording) return;

  const text = writeMovement(recording.trace);
  expect(text).toContain("# scene: courtyard\n# recorded: 2026-01-02T03:04:05.000Z\n");
  deck.insert(addFile("saved.csv", readMovement(text)));
  deck.play();
  for (const [i, at] of times.entries()) {
    rig.sample(at + 5000);
    for (const [axis, value] of (seen[i]?.position ?? []).entries()) {
      expect(rig.pose.position[axis]).toBeCloseTo(value, 5);
    }
    for (const [axis, value] of (seen[i]?.quaternion ?? []).entries()) {
      expect(rig.pose.quaternion[axis]).toBeCloseTo(value, 5);
    }
  }
});

test("a recording outlasts its scene", () => {
  deck.record();
  rig.sample(100);
  deck.dispose();
  expect(movements.value.map(({ name }) => name)).toEqual(["walk.csv", "Recording 1"]);
});

test("a file that is read again takes the place of the one before", () => {
  const again = addFile("walk.csv", WALK);
  expect(movements.value).toEqual([again]);
});
