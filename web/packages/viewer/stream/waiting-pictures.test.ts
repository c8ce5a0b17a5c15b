import { beforeEach, expect, test } from "vitest";
import { WaitingPictures } from "./waiting-pictures";

class Picture {
  open = true;
  close(): void {
    this.open = false;
  }
}

let waiting: WaitingPictures<Picture>;

beforeEach(() => {
  waiting = new WaitingPictures();
});

function add(frame: number): Picture {
  const picture = new Picture();
  waiting.add(frame, picture);
  return picture;
}

test("a picture is given once, and those before it never", () => {
  const [first, second, third] = [add(1), add(2), add(3)];
  expect(waiting.take(2)).toBe(second);
  expect(waiting.take(2)).toBeNull();
  expect(waiting.take(1)).toBeNull();
  expect([first, second, third].map(({ open }) => open)).toEqual([false, true, true]);
  expect(waiting.take(3)).toBe(third);
});

test("of frames that nobody tells of only the newest wait", () => {
  const pictures = Array.from({ length: 5 }, (_, frame) => add(frame));
  expect(pictures.map(({ open }) => open)).toEqual([false, false, true, true, true]);
  waiting.clear();
  expect(pictures.some(({ open }) => open)).toBe(false);
});
