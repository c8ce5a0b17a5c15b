/** The socket that moves the camera of a DASH stream and reports the pose of its frames. */
import type { FrameShown, PoseUpdate, SessionInfo } from "#client/wire/dash";

export interface PoseSocket {
  /** Sends a pose; returns false if an earlier one is still waiting, and the newest must be tried again. */
  send(pose: PoseUpdate): boolean;
  close(): void;
}

/** Opens the pose socket; `onFrame` receives the pose of each frame, `onClose` the reason of a close. */
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
      if (socket.readyState === WebSocket.CONNECTING) socket.addEventListener("open", () => socket.close());
      else socket.close();
    },
  };
}
