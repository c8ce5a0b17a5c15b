// @vitest-environment happy-dom

import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import { addUploaded } from "#viewer/state/api";
import { refreshScenes } from "../state/app";
import { added, addFiles, dismiss, isUploading, tryAgain, uploads } from "./uploads";

interface Callbacks {
  readonly onProgress: (sent: number) => void;
  readonly onSuccess: () => void;
  readonly onError: (error: unknown) => void;
  readonly onShouldRetry: (error: unknown) => boolean;
}

/** Inputs of the tus client and their outcomes, in order of the uploads. */
const begun = vi.hoisted(
  () => [] as { readonly name: string; readonly options: Callbacks; resumed: boolean; given: boolean | null }[],
);

const removeUpload = vi.hoisted(() => vi.fn());

vi.mock("#viewer/state/api");
vi.mock("../state/app");
vi.mock("tus-js-client", () => ({
  Upload: class {
    readonly url = "http://server.test/uploads/1";
    readonly options = { urlStorage: { removeUpload } };
    readonly #one: (typeof begun)[number];
    constructor(file: File, options: Callbacks) {
      this.#one = { name: file.name, options, resumed: false, given: null };
    }
    findPreviousUploads = async () => [{ urlStorageKey: "known" }];
    resumeFromPreviousUpload = () => {
      this.#one.resumed = true;
    };
    start = () => begun.push(this.#one);
    abort = async (terminate: boolean) => {
      this.#one.given = terminate;
    };
  },
}));

const file = (name: string, size = 4) => new File(["x".repeat(size)], name);
const begins = async (count: number) => {
  await vi.waitFor(() => expect(begun).toHaveLength(count), 5000);
  return begun[count - 1] as (typeof begun)[number];
};
const answer = (status: number, body: unknown) => ({
  originalResponse: { getStatus: () => status, getBody: () => JSON.stringify(body) },
});

beforeEach(() => {
  begun.length = 0;
  vi.mocked(addUploaded).mockResolvedValue({ id: "garden" });
});

afterEach(() => {
  for (const upload of uploads.value) dismiss(upload);
  vi.clearAllMocks();
});

test("files are sent one after the other, resume after interruptions, and leave the list as scenes", async () => {
  addFiles([file("garden.ply"), file("attic.ply")], 100);
  expect(isUploading.value).toBe(true);
  const first = await begins(1);
  expect(first.resumed).toBe(true);
  first.options.onProgress(3);
  expect(uploads.value.map(({ state }) => state.value)).toEqual([{ kind: "sending", sent: 3 }, { kind: "waiting" }]);
  vi.mocked(addUploaded).mockRejectedValueOnce(new ApiError("The server is not responding.", true));
  first.options.onSuccess();
  const second = await begins(2);
  expect(addUploaded).toHaveBeenCalledTimes(2);
  expect(refreshScenes).toHaveBeenCalledTimes(1);
  expect(second.name).toBe("attic.ply");
  second.options.onSuccess();
  await vi.waitFor(() => expect(uploads.value).toEqual([]));
  expect([...added.value]).toEqual(["garden"]);
});

test("a refusal is shown, and final ones are not retried", async () => {
  addFiles([file("garden.ply")], 100);
  const { options } = await begins(1);
  const refused = answer(422, { type: "tigas:scene-not-added", detail: "There is a scene garden already." });
  expect([refused, answer(507, {}), answer(503, {}), {}].map((error) => options.onShouldRetry(error))).toEqual([
    false,
    false,
    true,
    true,
  ]);
  options.onError(refused);
  const message = "There is a scene garden already.";
  await vi.waitFor(() => expect(uploads.value[0]?.state.value).toMatchObject({ kind: "failed", message }));
  expect(isUploading.value).toBe(false);
});

test.each([
  ["when it is tried again", () => tryAgain(uploads.value[0] as (typeof uploads.value)[number])],
  ["when the file is chosen again", () => addFiles([file("garden.ply")], 100)],
])("an upload that the server has kept is found %s, until it is a scene", async (_, send) => {
  vi.mocked(addUploaded).mockRejectedValueOnce(new ApiError("The disk is full.", false));
  addFiles([file("garden.ply")], 100);
  (await begins(1)).options.onSuccess();
  await vi.waitFor(() => expect(uploads.value[0]?.state.value).toMatchObject({ kind: "failed", again: true }));
  expect(removeUpload).not.toHaveBeenCalled();
  send();
  const again = await begins(2);
  expect(again.resumed).toBe(true);
  again.options.onSuccess();
  await vi.waitFor(() => expect(removeUpload).toHaveBeenCalledWith("known"));
});

test("an upload cancelled before it begins blocks no other", async () => {
  addFiles([file("garden.ply"), file("attic.ply")], 100);
  dismiss(uploads.value[0] as (typeof uploads.value)[number]);
  expect((await begins(1)).name).toBe("attic.ply");
});

test("a file that is too large is not sent", () => {
  addFiles([file("vast.ply", 101)], 100);
  expect(uploads.value[0]?.state.value).toMatchObject({ kind: "failed", again: false });
  expect(begun).toEqual([]);
});

test("a cancelled upload is removed from the server, and the next begins", async () => {
  addFiles([file("garden.ply"), file("attic.ply")], 100);
  const first = await begins(1);
  dismiss(uploads.value[0] as (typeof uploads.value)[number]);
  expect((await begins(2)).name).toBe("attic.ply");
  expect(first.given).toBe(true);
  expect(addUploaded).not.toHaveBeenCalled();
});
