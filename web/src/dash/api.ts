/** The packager's API: a stream of one's own, and the socket that moves its camera. */

import { ApiError, readProblem } from "../http/problem";
import { mixedContent } from "../http/reach";
import type { FrameShown, PoseUpdate, SessionInfo, SessionRequest } from "../wire/dash";

/** Opening waits for the scene to load and for the first frame. */
const OPEN_TIMEOUT = 60_000;

export async function openSession(base: string, request: SessionRequest, signal: AbortSignal): Promise<SessionInfo> {
  if (mixedContent(base, location.href)) {
    throw new ApiError(
      "Browsers do not let a secure page use a DASH packager over plain HTTP: open this page over http:// to see the stream.",
      false,
    );
  }
  let response: Response;
  try {
    const limit = AbortSignal.any([signal, AbortSignal.timeout(OPEN_TIMEOUT)]);
    // Plain text needs no preflight, which would be one more round trip.
    response = await fetch(`${base}/sessions`, { method: "POST", body: JSON.stringify(request), signal: limit });
    if (response.ok) return (await response.json()) as SessionInfo;
  } catch (error) {
    if (signal.aborted) throw error;
    throw new ApiError("The DASH packager does not answer.", true);
  }
  // Too many streams, or a render service that is away: another try may help, as when nobody answers.
  throw new ApiError((await readProblem(response)).detail, response.status >= 500);
}

/** Ends a stream at once; it would end by itself a little later. Works while the page is being left, too. */
export function endSession(base: string, { id }: SessionInfo): void {
  void fetch(`${base}/sessions/${id}`, { method: "DELETE", keepalive: true }).catch(() => undefined);
}

export interface PoseSocket {
  /** Sends a pose, unless an earlier one still waits: then false, and the newest is to be tried again. */
  send(pose: PoseUpdate): boolean;
  close(): void;
}

/** Opens the pose socket; `onFrame` hears which pose each frame shows, `onClose` why there will be no more. */
export function openPoseSocket(
  base: string,
  { poses }: SessionInfo,
  onFrame: (frame: FrameShown) => void,
  onClose: () => void,
): PoseSocket {
  const socket = new WebSocket(`${base.replace(/^http/, "ws")}${poses}`);
  socket.addEventListener("message", ({ data }) => {
    const message = JSON.parse(String(data)) as FrameShown | { readonly type: string };
    if ("frame" in message) onFrame(message);
  });
  socket.addEventListener("close", onClose);
  return {
    send(pose) {
      if (socket.readyState !== WebSocket.OPEN || socket.bufferedAmount > 0) return false;
      socket.send(JSON.stringify(pose));
      return true;
    },
    close() {
      socket.removeEventListener("close", onClose);
      socket.close();
    },
  };
}
