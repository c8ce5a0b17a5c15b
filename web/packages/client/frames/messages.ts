/** Messages between a page and its frame worker. Ids are unique per worker; a session has the id of the message that opens it. */
import type { SessionOptions } from "../transport/session";
import {
  type DecodedImage,
  FrameDropped,
  type FrameReply,
  type FrameTransport,
  RequestProblem,
  type TransportKind,
} from "../transport/transport";
import type { Problem, RenderRequest } from "../wire/render";

export type SessionKind = Exclude<TransportKind, "fetch">;

export type ToWorker =
  | {
      readonly kind: "open";
      readonly id: number;
      readonly transport: SessionKind;
      readonly options: SessionOptions;
      /** The page's `performance.timeOrigin`: times are on the page's clock. */
      readonly timeOrigin: number;
    }
  | { readonly kind: "request"; readonly id: number; readonly session: number; readonly request: RenderRequest }
  | { readonly kind: "decode"; readonly id: number; readonly image: Blob }
  | { readonly kind: "abort"; readonly id: number }
  | { readonly kind: "close"; readonly session: number }
  /** Closes everything and ends the worker. */
  | { readonly kind: "end" };

export type FromWorker =
  | ({ readonly kind: "opened"; readonly id: number } & Pick<FrameTransport, "maxInFlight" | "overtaking">)
  | { readonly kind: "reply"; readonly id: number; readonly reply: Omit<FrameReply, "picture"> }
  /** Follows a reply, except for a frame of a video, and answers a message to decode. */
  | { readonly kind: "picture"; readonly id: number; readonly picture: DecodedImage }
  | { readonly kind: "failed"; readonly id: number; readonly failure: Failure }
  | { readonly kind: "lost"; readonly session: number; readonly reason: string };

/** An error as a message: structured clones keep neither its class nor its fields. */
export type Failure =
  | { readonly kind: "problem"; readonly problem: Problem }
  | { readonly kind: "dropped"; readonly message: string }
  | { readonly kind: "error"; readonly name: string; readonly message: string };

export function failureOf(error: unknown): Failure {
  if (error instanceof RequestProblem) return { kind: "problem", problem: error.problem };
  if (error instanceof FrameDropped) return { kind: "dropped", message: error.message };
  const { name, message } = error instanceof Error || error instanceof DOMException ? error : new Error(String(error));
  return { kind: "error", name, message };
}

export function errorOf(failure: Failure): Error {
  switch (failure.kind) {
    case "problem":
      return new RequestProblem(failure.problem);
    case "dropped":
      return new FrameDropped(failure.message);
    case "error":
      return Object.assign(new Error(failure.message), { name: failure.name });
  }
}
