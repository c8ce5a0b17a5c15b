/** Whether this browser decodes video frame by frame. */

/** The main profile, as the server encodes; level 3.1 has the paper's best rung. */
const CODEC = "avc1.4d001f";

/** Null where it does, or else why not, in a sentence for a person. */
export async function videoProblem(): Promise<string | null> {
  if (typeof VideoDecoder === "undefined") {
    const why = isSecureContext ? "This browser has no WebCodecs" : "Browsers decode single frames only over HTTPS";
    return `${why}, which the mode Video needs. Choose another mode.`;
  }
  const { supported } = await VideoDecoder.isConfigSupported({ codec: CODEC, optimizeForLatency: true }).catch(() => ({
    supported: false,
  }));
  return supported ? null : "This browser does not decode H.264, which the mode Video needs. Choose another mode.";
}
