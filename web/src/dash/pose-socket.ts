/** The socket that moves the camera of a stream over DASH, and says what its frames show. */
import type { FrameShown, PoseUpdate, SessionInfo } from "../wire/dash";

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
