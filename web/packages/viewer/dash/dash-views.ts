/** A stream over DASH: a session of the packager's, the socket that moves its camera, and the player of its manifest. */

import { ApiError } from "#client/http/problem";
import type { SessionRequest } from "#client/wire/dash";
import { endSession, openSession, sessionStatus } from "../stream/packager";
import type { OpenViews } from "../stream/stream";
import { openPoseSocket } from "./pose-socket";
import type { DashPlan } from "./presets";

export interface DashSource {
  /** Where the packager is. */
  readonly base: string;
  readonly scene: string;
  readonly plan: DashPlan;
}

export function overDash({ base, scene, plan }: DashSource): OpenViews {
  return async (video, view, events, signal) => {
    const player = plan.player === "mse" ? import("./mse-stream") : import("./dashjs-stream");
    const { playStream } = await player.catch(() => {
      throw new ApiError("The player could not be loaded from the server. Reload the page.", false);
    });
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
    const leave = () => {
      poses.close();
      void endSession(base, session);
    };
    try {
      const stream = playStream(video, `${base}${session.manifest}`, events);
      const { id: _, manifest: __, poses: ___, ...played } = session;
      return {
        ...stream,
        targetLatency: session.target_latency_ms,
        played: { dash: { ...played, player: stream.player } },
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
