/** A stream over DASH: a session of the packager's, the socket that moves its camera, and the player of its manifest. */

import { ApiError } from "#client/http/problem";
import type { SessionRequest } from "#client/wire/dash";
import { endSession, openSession, sessionStatus } from "../stream/packager";
import type { OpenViews } from "../stream/stream";
import { openPoseSocket } from "./pose-socket";
import type { DashPlan } from "./presets";
import { SegmentProtocols } from "./segment-protocols";

/** Time limit of the handshake, in milliseconds. */
const H3_TIMEOUT = 10_000;

export interface DashSource {
  readonly base: string;
  /** The same over HTTP/3; null if it is not offered. */
  readonly h3: string | null;
  readonly scene: string;
  readonly plan: DashPlan;
}

export function overDash({ base, h3, scene, plan }: DashSource): OpenViews {
  return async (video, view, events, signal) => {
    const player = plan.player === "mse" ? import("./mse-stream") : import("./dashjs-stream");
    const { playStream } = await player.catch(() => {
      throw new ApiError("The player could not be loaded from the server. Reload the page.", false);
    });
    const media = plan.transport === "h3" ? await reachedOverH3(h3, signal) : base;
    // Unless a single representation is requested, the packager chooses them: it knows the ladder and the viewport.
    const request: SessionRequest = {
      scene,
      ...view,
      ...plan.setup,
      ...(plan.representation && { representations: [plan.representation] }),
    };
    const session = await openSession(base, request, signal);
    const { told, failed } = events;
    const poses = openPoseSocket(
      base,
      session,
      ({ frame, pose }) => told(frame, pose),
      () => failed("The DASH stream was interrupted."),
    );
    const protocols = new SegmentProtocols(`${media}/sessions/${session.id}/`);
    const leave = () => {
      protocols.dispose();
      poses.close();
      void endSession(base, session);
    };
    try {
      const stream = playStream(video, `${media}${session.manifest}`, events);
      const { id: _, manifest: __, poses: ___, ...played } = session;
      return {
        ...stream,
        targetLatency: session.target_latency_ms,
        get played() {
          return { dash: { ...played, player: stream.player, protocols: protocols.seen } };
        },
        receiver: () => null,
        status: (asked) => sessionStatus(base, session, asked),
        send: poses.send,
        frame: (mediaTime) => Math.round(mediaTime * session.frame_rate),
        rung: (width, height) =>
          session.representations.find((one) => one.width === width && one.height === height)?.rung ?? null,
        dispose() {
          stream.dispose();
          leave();
        },
      };
    } catch (error) {
      leave();
      throw error;
    }
  };
}

/** The URL of an HTTP/3 server that this browser trusts. */
async function reachedOverH3(url: string | null, signal: AbortSignal): Promise<string> {
  if (url === null) throw new ApiError("This server does not offer DASH over HTTP/3.", false);
  try {
    await fetch(`${url}/time`, {
      cache: "no-store",
      signal: AbortSignal.any([signal, AbortSignal.timeout(H3_TIMEOUT)]),
    });
  } catch {
    signal.throwIfAborted();
    throw new ApiError(
      "This browser cannot reach DASH over HTTP/3, or does not trust the server’s certificate.",
      false,
    );
  }
  return url;
}
