import { beforeEach, expect, test } from "vitest";
import { FormatChoice } from "./picture-format";

let subject: FormatChoice;

beforeEach(() => {
  subject = new FormatChoice();
});

/** Records pictures of 640×360. */
function came(type: string, bytes: number, encode: number, { count = 1, now = 0 } = {}): void {
  const header = { status: 200, seq: 0, content_type: type, width: 640, height: 360 };
  const arrival = { sentAt: 0, firstByteAt: 0, lastByteAt: 0, bytes, sharedBytes: 0 };
  for (let i = 0; i < count; i++)
    subject.observe({ header: { ...header, timing: { queue: 0, render: 9, encode } }, arrival }, now);
}

test.each([
  { when: "nothing is known of the link", throughput: null, bytes: 20_000, format: "jpeg" },
  { when: "the link is fast", throughput: 20e6, bytes: 20_000, format: "jpeg" },
  { when: "the link is slow", throughput: 2e6, bytes: 20_000, format: "webp" },
  { when: "the link is slow but pictures are tiny", throughput: 2e6, bytes: 4_000, format: "jpeg" },
])("pictures come as $format where $when", ({ throughput, bytes, format }) => {
  expect(subject.next(throughput, 0)).toBe("jpeg");
  came("image/jpeg", bytes, 0.5);
  expect(subject.next(throughput, 0)).toBe(format);
});

test("a choice stays where the other one would be hardly better", () => {
  came("image/jpeg", 20_000, 0.5);
  const even = (0.2 * 20_000 * 8) / 5.07; // kilobits per second at which both take as long
  const formats = [1.1, 0.9, 0.7, 0.9, 1.1, 1.4, 1.1].map((share) => subject.next(share * even * 1000, 0));
  expect(formats).toEqual(["jpeg", "jpeg", "webp", "webp", "webp", "jpeg", "jpeg"]);
});

test("as WebP, pictures are as good a reason for it as they were as JPEG", () => {
  came("image/jpeg", 20_000, 0.5);
  expect(subject.next(4e6, 0)).toBe("webp");
  came("image/webp", 16_000, 4.1, { count: 50 });
  expect(subject.next(4e6, 0)).toBe("webp");
});

test("a server that takes long over WebP is not asked for it, for a while", () => {
  came("image/jpeg", 20_000, 0.5);
  expect(subject.next(2e6, 0)).toBe("webp");
  came("image/webp", 16_000, 60, { count: 10, now: 1000 });
  expect(subject.next(2e6, 1000)).toBe("jpeg");
  came("image/jpeg", 20_000, 0.5, { now: 9000 });
  expect(subject.next(2e6, 9000)).toBe("jpeg");
  expect(subject.next(2e6, 17_000)).toBe("webp");
});
