/**
 * Control of a page in a frame by the page around it: messages `{tigas, id, …}`, each answered with the same `tigas` and `id`.
 * Only the parent may send them, and only if the server allows it: its policy `frame-ancestors` names the setting `allow_origins`.
 */
import type { ViewerControl } from "../control/viewer-control";
import type { Easing } from "../movement/camera-path";
import type { Settings } from "../state/settings";
import type { ScenePose } from "../view/camera";
import { poseOf } from "../view/pose-text";

type Control = Pick<ViewerControl, "animate" | "camera" | "on" | "screenshot" | "set" | "settings">;

/** An unchecked message, with all fields that any message may have. */
interface Message {
  readonly tigas: string;
  readonly id?: unknown;
  readonly camera?: ScenePose;
  readonly duration?: number;
  readonly easing?: Easing;
  readonly settings?: Partial<Settings>;
  readonly width?: number;
  readonly height?: number;
}

const ACTIONS: Readonly<Record<string, (control: Control, message: Message) => Promise<object>>> = {
  camera: async (control, { camera, duration, easing }) => {
    if (camera !== undefined) {
      const pose = checked(camera);
      if (duration === undefined) control.camera = pose;
      else await control.animate(pose, { duration, ...(easing !== undefined && { easing }) });
    }
    return { camera: control.camera };
  },
  settings: async (control, { settings }) => {
    if (settings !== undefined) control.set(settings);
    return { settings: control.settings };
  },
  screenshot: async (control, { width, height }) => ({
    screenshot: await control.screenshot({
      ...(width !== undefined && { width }),
      ...(height !== undefined && { height }),
    }),
  }),
};

/** Answers the parent's messages and sends it `{tigas: "loaded", scene}`; returns a function that stops. */
export function answerParent(control: Control, frame: Window = window): () => void {
  const { parent } = frame;
  if (parent === frame) return () => undefined;
  const hear = ({ source, origin, data }: MessageEvent) => {
    if (source !== parent || typeof data?.tigas !== "string" || origin === "null") return;
    void answer(control, data).then((reply) => parent.postMessage(reply, origin));
  };
  frame.addEventListener("message", hear);
  const stopTelling = control.on("loaded", ({ id }) => parent.postMessage({ tigas: "loaded", scene: id }, "*"));
  return () => {
    frame.removeEventListener("message", hear);
    stopTelling();
  };
}

async function answer(control: Control, message: Message): Promise<object> {
  const { tigas, id } = message;
  try {
    const act = Object.hasOwn(ACTIONS, tigas) ? ACTIONS[tigas] : undefined;
    if (act === undefined) throw new Error(`Unknown message “${tigas}”: use ${Object.keys(ACTIONS).join(", ")}.`);
    return { tigas, id, ...(await act(control, message)) };
  } catch (error) {
    return { tigas, id, error: error instanceof Error ? error.message : String(error) };
  }
}

function checked({ position, quaternion }: ScenePose): ScenePose {
  const pose = poseOf(`${position},${quaternion}`);
  if (pose === null) throw new Error("The camera must be {position: [x, y, z], quaternion: [x, y, z, w]}.");
  return pose;
}
