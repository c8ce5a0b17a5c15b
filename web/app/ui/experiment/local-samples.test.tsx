// @vitest-environment happy-dom
import { cleanup, render, screen, within } from "@testing-library/preact";
import userEvent from "@testing-library/user-event";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { deferred } from "#client/async/deferred";
import { ApiError } from "#client/http/problem";
import { StoreApi } from "#lab/experiment/store-api";
import { LocalSamples } from "./local-samples";

const { runs, upload } = vi.hoisted(() => ({ runs: [] as object[], upload: vi.fn() }));
vi.mock("#lab/samples/sampled-runs", () => ({ listSampledRuns: async () => [...runs] }));
vi.mock("#lab/experiment/sample-upload", () => ({
  uploadSamples: upload,
  deleteSamples: async (key: string) => {
    runs.splice(
      runs.findIndex((run) => (run as { key: string }).key === key),
      1,
    );
  },
}));

const STORE = new StoreApi("http://store.test");
const ABOUT = { experiment: "Bus", title: "Seen", started_unix_ms: 5 };
const run = (key: string, more: object = {}) => ({
  key,
  about: ABOUT,
  samples: [1, 2, 3],
  bytes: 1_500_000,
  busy: false,
  ...more,
});
const onUploaded = vi.fn();

beforeEach(() => {
  runs.length = 0;
  vi.clearAllMocks();
});
afterEach(cleanup);

async function shown(store: StoreApi | null = STORE): Promise<HTMLElement[]> {
  render(<LocalSamples store={store} onUploaded={onUploaded} />);
  return (await screen.findAllByRole("row")).slice(1);
}

test("nothing is said where there are no samples", async () => {
  const { container } = render(<LocalSamples store={STORE} onUploaded={onUploaded} />);
  await Promise.resolve();
  expect(container.textContent).toBe("");
});

test("a run is named with how much there is of it, and deleted when a person says so", async () => {
  runs.push(run("a"));
  const [row] = await shown();
  expect(row?.textContent).toContain("Bus, Seen");
  expect(row?.textContent).toContain("31.5 MB");
  const ask = async (answer: string) => {
    await userEvent.click(screen.getByRole("button", { name: "Delete" }));
    const question = within(await screen.findByRole("dialog", { name: "Delete the samples of “Bus, Seen”?" }));
    await userEvent.click(question.getByRole("button", { name: answer }));
  };
  await ask("Cancel");
  await vi.waitFor(() => expect(screen.queryByRole("dialog")).toBeNull());
  expect(runs).toHaveLength(1);
  await ask("Delete");
  await vi.waitFor(() => expect(screen.queryByRole("row")).toBeNull());
});

test("an upload shows how far it is, and what keeps it", async () => {
  runs.push(run("a"));
  const ended = deferred<void>();
  upload.mockImplementation(({ progress }: { progress: (sent: number) => void }) => {
    progress(500_000);
    return ended.promise;
  });
  await shown();
  await userEvent.click(screen.getByRole("button", { name: "Upload" }));
  expect(upload).toHaveBeenCalledWith(expect.objectContaining({ key: "a", store: STORE }));
  await vi.waitFor(() => expect(screen.getByLabelText<HTMLProgressElement>("Upload progress").value).toBe(500_000));
  ended.reject(new ApiError("The disk is full.", false));
  expect((await screen.findByRole("alert")).textContent).toBe("The disk is full.");
  expect(await screen.findByRole("button", { name: "Upload" })).toBeTruthy();
});

test("what another tab uses cannot be touched; what nobody knows of, and where no store is, can only be deleted", async () => {
  runs.push(run("a", { busy: true }), run("b", { about: null }));
  const [busy, unknown] = await shown();
  expect(busy?.textContent).toContain("In use by another tab");
  expect(busy?.querySelector("button")).toBeNull();
  expect([...(unknown?.querySelectorAll("button") ?? [])].map(({ textContent }) => textContent?.trim())).toEqual([
    "Delete",
  ]);
  cleanup();
  runs.splice(0, 2, run("c"));
  await shown(null);
  expect(screen.queryByRole("button", { name: "Upload" })).toBeNull();
});
