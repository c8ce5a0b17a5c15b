import { expect, test } from "vitest";
import { GpuTimer } from "./gpu-timer";

/** Queries that are answered when the test says so. */
class FakeGl {
  readonly QUERY_RESULT = 1;
  readonly QUERY_RESULT_AVAILABLE = 2;
  readonly queries: { ms: number | null; deleted: boolean }[] = [];
  disjoint = false;

  getExtension(): unknown {
    return { TIME_ELAPSED_EXT: 3, GPU_DISJOINT_EXT: 4 };
  }

  getParameter(): boolean {
    return this.disjoint;
  }

  createQuery(): unknown {
    this.queries.push({ ms: null, deleted: false });
    return this.queries.at(-1);
  }

  getQueryParameter(query: { ms: number | null }, name: number): unknown {
    return name === this.QUERY_RESULT_AVAILABLE ? query.ms !== null : (query.ms ?? Number.NaN) * 1e6;
  }

  deleteQuery(query: { deleted: boolean }): void {
    query.deleted = true;
  }

  beginQuery(): void {}
  endQuery(): void {}
}

function timed(gl: FakeGl, timer: GpuTimer, times: readonly number[]): void {
  for (const ms of times) {
    timer.begin();
    timer.end();
    for (const query of gl.queries) query.ms ??= ms;
  }
  timer.begin();
  timer.end();
}

const started = () => {
  const gl = new FakeGl();
  return { gl, timer: new GpuTimer(gl as unknown as WebGL2RenderingContext) };
};

test("one slow draw among many does not count", () => {
  const { gl, timer } = started();
  timed(gl, timer, [400, 3, 3, 3, 3, 3, 3, 3]);
  expect(timer.ms).toBeNull();
  timed(gl, timer, [3, 3, 3, 3, 3, 3, 3, 3, 3]);
  expect(timer.ms).toBe(3);
  expect(gl.queries.filter(({ deleted }) => !deleted).length).toBe(1);
});

test("what a disjoint clock says is ignored", () => {
  const { gl, timer } = started();
  gl.disjoint = true;
  timed(
    gl,
    timer,
    Array.from({ length: 20 }, () => 3),
  );
  expect(timer.ms).toBeNull();
});

test("a processor that does not answer is not asked more and more", () => {
  const { gl, timer } = started();
  for (let i = 0; i < 20; i++) {
    timer.begin();
    timer.end();
  }
  expect(gl.queries.length).toBe(4);
});

test("without the extension nothing is known", () => {
  const timer = new GpuTimer({ getExtension: () => null } as unknown as WebGL2RenderingContext);
  timer.begin();
  timer.end();
  expect(timer.ms).toBeNull();
});
