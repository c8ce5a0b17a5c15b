/** Calls to a worker, by id → promise. */
import { type Deferred, deferred } from "./deferred";

export interface WorkerCall<Request> {
  readonly id: number;
  readonly request: Request;
}

export type WorkerAnswer<Value> =
  | { readonly id: number; readonly value: Value }
  | { readonly id: number; readonly error: { readonly name: string; readonly message: string } };

/** In the worker: the reply, sent once the work is done. */
export async function answerTo<Value>(id: number, work: Promise<Value>): Promise<WorkerAnswer<Value>> {
  try {
    return { id, value: await work };
  } catch (error) {
    const { name, message } =
      error instanceof Error || error instanceof DOMException ? error : new Error(String(error));
    return { id, error: { name, message } };
  }
}

/** The part of Worker that is used, for tests. */
export type CalledWorker = Pick<Worker, "postMessage" | "terminate" | "onmessage" | "onerror">;

export class WorkerCalls<Request, Value> {
  readonly #worker: CalledWorker;
  readonly #unwanted: (value: Value) => void;
  readonly #waiting = new Map<number, Deferred<Value>>();
  #nextId = 0;
  #failed: Error | undefined;

  /** `unwanted` gets replies that arrive after all calls were cancelled. */
  constructor(worker: CalledWorker, unwanted: (value: Value) => void = () => undefined) {
    this.#worker = worker;
    this.#unwanted = unwanted;
    worker.onmessage = ({ data }: MessageEvent<WorkerAnswer<Value>>) => this.#receive(data);
    worker.onerror = (event) => this.#fail(new Error(event.message || "a worker could not be started"));
  }

  /** Rejects with an Error that has the name and message of the worker's error. */
  call(request: Request, transfer: Transferable[] = []): Promise<Value> {
    if (this.#failed) return Promise.reject(this.#failed);
    const waiting = deferred<Value>();
    const id = this.#nextId++;
    this.#waiting.set(id, waiting);
    this.#worker.postMessage({ id, request } satisfies WorkerCall<Request>, transfer);
    return waiting.promise;
  }

  dispose(): void {
    this.#worker.terminate();
    this.#fail(new Error("the worker was ended"));
  }

  #receive(answer: WorkerAnswer<Value>): void {
    const waiting = this.#waiting.get(answer.id);
    this.#waiting.delete(answer.id);
    if ("error" in answer) waiting?.reject(Object.assign(new Error(answer.error.message), { name: answer.error.name }));
    else if (waiting) waiting.resolve(answer.value);
    else this.#unwanted(answer.value);
  }

  #fail(error: Error): void {
    this.#failed = error;
    const waiting = [...this.#waiting.values()];
    this.#waiting.clear();
    for (const { reject } of waiting) reject(error);
  }
}
