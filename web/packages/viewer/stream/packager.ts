/** The packager's API: one stream per viewer, over DASH or WebRTC. */
import { ApiError, mixedContent, readProblem } from "#client/http/problem";
import type { SessionInfo, SessionRequest, SessionStatus, WebRtcRequest, WebRtcSession } from "#client/wire/dash";
import { STREAM_NAMES, type StreamKind } from "./stream";

/**
 * Share of a stream's frames that repeat the view although the camera moves: the renderer or the encoder cannot keep
 * up.
 */
type Counts = Pick<SessionStatus, "id" | "frames" | "repeated" | "dropped">;

/** Above this share, the server is the limit. */
export const MANY_REPEATS = 0.25;

/**
 * Share from `before` to `after`, 0 to 1, of frames repeated for lack of a newer view, or skipped; null without frames.
 */
export function repeatedShare(before: Counts | null, after: Counts | null): number | null {
  if (before === null || after === null || before.id !== after.id) return null;
  const ticks = after.frames - before.frames + (after.dropped - before.dropped);
  if (ticks <= 0) return null;
  return Math.min(1, (after.repeated - before.repeated + (after.dropped - before.dropped)) / ticks);
}

/** Time limit of opening, which waits for the scene to load and for the first frame. */
const OPEN_TIMEOUT = 60_000;
const END_TIMEOUT = 5000;

export function openSession(base: string, request: SessionRequest, signal: AbortSignal): Promise<SessionInfo> {
  return open("dash", base, "sessions", request, signal);
}

/** The same over WebRTC: sends an offer and returns its answer. */
export function openWebRtc(base: string, request: WebRtcRequest, signal: AbortSignal): Promise<WebRtcSession> {
  return open("webrtc", base, "webrtc", request, signal);
}

/** Opens a stream; waits for the name of an unwanted one to end it, which requires the name. */
async function open<Opened extends Pick<SessionInfo, "id">>(
  kind: StreamKind,
  base: string,
  path: string,
  request: unknown,
  signal: AbortSignal,
): Promise<Opened> {
  const name = STREAM_NAMES[kind];
  if (mixedContent(base, location.href)) {
    throw new ApiError(
      `Browsers do not let a secure page open a ${name} stream over plain HTTP: open this page over http:// to see it.`,
      false,
    );
  }
  signal.throwIfAborted();
  let response: Response;
  try {
    const limit = AbortSignal.timeout(OPEN_TIMEOUT);
    // Plain text needs no preflight, which would be one more round trip.
    response = await fetch(`${base}/${path}`, { method: "POST", body: JSON.stringify(request), signal: limit });
    if (response.ok) {
      const opened = (await response.json()) as Opened;
      if (signal.aborted) void endSession(base, opened);
      signal.throwIfAborted();
      return opened;
    }
  } catch (error) {
    if (signal.aborted) throw error;
    throw new ApiError(`The ${name} streaming server is not responding.`, true);
  }
  // Too many streams, or the render service is down: a retry may help, as without an answer.
  throw new ApiError((await readProblem(response)).detail, response.status >= 500);
}

/** Ends a stream at once instead of by timeout. Works while the page unloads. Never rejects. */
export async function endSession(base: string, { id }: Pick<SessionInfo, "id">): Promise<void> {
  const limit = AbortSignal.timeout(END_TIMEOUT);
  await fetch(`${base}/sessions/${id}`, { method: "DELETE", keepalive: true, signal: limit }).catch(() => undefined);
}

/** State of a stream; null if the packager does not report it. */
export async function sessionStatus(
  base: string,
  { id }: Pick<SessionInfo, "id">,
  signal: AbortSignal,
): Promise<SessionStatus | null> {
  try {
    const response = await fetch(`${base}/sessions/${id}`, { signal, cache: "no-store" });
    return response.ok ? ((await response.json()) as SessionStatus) : null;
  } catch {
    return null;
  }
}
