import { expect, test } from "vitest";
import type { Sample } from "#client/wire/store";
import { FakeDisk } from "#fakes/opfs";
import type { About } from "./layout";
import { SampleFiles } from "./sample-files";

const ABOUT = { name: "bus", experiment: null, run: null } as unknown as About;
const sample = (seq: number, enhanced = false) => ({ seq, enhanced }) as Sample;
const jpeg = (text: string) => new Blob([text], { type: "image/jpeg" });

test("pictures are written as they are, and then named in the index", async () => {
  const disk = new FakeDisk();
  const files = await SampleFiles.create(disk.folder, ABOUT);
  expect(await files.keep(sample(7), jpeg("seven"), null)).toBe(5);
  expect(await files.keep(sample(12, true), jpeg("ab"), new Blob(["cd"], { type: "image/webp" }))).toBe(4);
  await files.keep(sample(13, true), jpeg("x"), new Blob(["png"], { type: "image/png" }));
  expect(disk.root.texts).toEqual({
    "run.json": JSON.stringify(ABOUT),
    "000007.jpg": "seven",
    "000012.jpg": "ab",
    "000012.enhanced.webp": "cd",
    "000013.jpg": "x",
    "000013.enhanced.png": "png",
    "samples.ndjson": [sample(7), sample(12, true), sample(13, true)].map((one) => `${JSON.stringify(one)}\n`).join(""),
  });
});

test.each([3, 12, 20, 30])("of a sample that does not fit into %s bytes, nothing is left", async (room) => {
  const disk = new FakeDisk();
  const files = await SampleFiles.create(disk.folder, ABOUT);
  await files.keep(sample(1), jpeg("first"), null);
  const before = disk.root.texts;
  disk.room = room;
  const picture = new Blob(["enhanced"], { type: "image/webp" });
  await expect(files.keep(sample(2, true), jpeg("second jpeg"), picture)).rejects.toMatchObject({
    name: "QuotaExceededError",
  });
  expect(disk.root.texts).toEqual(before);
  disk.room = 1000;
  await files.keep(sample(3), jpeg("third"), null);
  expect(disk.root.texts["samples.ndjson"]).toBe(`${JSON.stringify(sample(1))}\n${JSON.stringify(sample(3))}\n`);
});

test("nobody else writes there meanwhile", async () => {
  const disk = new FakeDisk();
  const files = await SampleFiles.create(disk.folder, ABOUT);
  await expect(SampleFiles.create(disk.folder, ABOUT)).rejects.toMatchObject({ name: "NoModificationAllowedError" });
  files.close();
  await SampleFiles.create(disk.folder, ABOUT);
});

test("a folder that cannot be begun is closed again", async () => {
  const disk = new FakeDisk();
  disk.room = 4;
  await expect(SampleFiles.create(disk.folder, ABOUT)).rejects.toMatchObject({ name: "QuotaExceededError" });
  disk.room = 1000;
  await SampleFiles.create(disk.folder, ABOUT);
});
