/** GPU time of a frame: by timestamp queries where available, else the time until the work is reported as complete. */

const BYTES = 16;

export class Stopwatch {
  readonly #queries: GPUQuerySet;
  readonly #resolved: GPUBuffer;
  readonly #read: GPUBuffer;

  private constructor(device: GPUDevice) {
    this.#queries = device.createQuerySet({ type: "timestamp", count: 2 });
    this.#resolved = device.createBuffer({
      size: BYTES,
      usage: GPUBufferUsage.QUERY_RESOLVE | GPUBufferUsage.COPY_SRC,
    });
    this.#read = device.createBuffer({ size: BYTES, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
  }

  /** A stopwatch for a device; null if it has no timestamps for pages. */
  static of(device: GPUDevice): Stopwatch | null {
    return device.features.has("timestamp-query") ? new Stopwatch(device) : null;
  }

  /** Encodes the first timestamp, before the work. */
  start(encoder: GPUCommandEncoder): void {
    encoder.beginComputePass({ timestampWrites: { querySet: this.#queries, beginningOfPassWriteIndex: 0 } }).end();
  }

  /** Timestamp writes for the work's last pass. */
  get last(): GPURenderPassTimestampWrites {
    return { querySet: this.#queries, endOfPassWriteIndex: 1 };
  }

  /** Encodes the reading of the timestamps, after the work. */
  stop(encoder: GPUCommandEncoder): void {
    encoder.resolveQuerySet(this.#queries, 0, 2, this.#resolved, 0);
    encoder.copyBufferToBuffer(this.#resolved, 0, this.#read, 0, BYTES);
  }

  /**
   * The time in milliseconds, once the work is done; null if the clock's values are absurd, as after a suspension of the GPU.
   */
  async read(atMost: number): Promise<number | null> {
    await this.#read.mapAsync(GPUMapMode.READ);
    const [begun = 0n, ended = 0n] = new BigUint64Array(this.#read.getMappedRange());
    this.#read.unmap();
    const time = Number(ended - begun) / 1e6;
    return time > 0 && time <= atMost ? time : null;
  }
}
