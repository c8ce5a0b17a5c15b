/** Converts a frame's HTTP headers into the header that precedes it over WebTransport. */
import type { FrameHeader, ServerTiming } from "../wire/render";

export function frameHeader(status: number, headers: Headers): FrameHeader {
  const frame = parameters(headers.get("Tigas-Frame") ?? "", ",");
  return {
    status,
    seq: frame.get("seq") ?? 0,
    content_type: headers.get("Content-Type") ?? "",
    width: frame.get("width") ?? null,
    height: frame.get("height") ?? null,
    margin_x: frame.get("margin_x") ?? null,
    margin_y: frame.get("margin_y") ?? null,
    profile: frame.get("profile") ?? null,
    coarse: frame.has("coarse") || null,
    timing: serverTiming(headers.get("Server-Timing") ?? ""),
    requests_per_s: frame.get("requests_per_s") ?? null,
  };
}

/** `queue;dur=0.1, render;dur=12, encode;dur=1.5`, or null if one of the three is missing. */
function serverTiming(field: string): ServerTiming | null {
  const durations = new Map<string, number>();
  for (const metric of field.split(",")) {
    const [name, ...rest] = metric.split(";");
    const duration = parameters(rest.join(";"), ";").get("dur");
    if (name !== undefined && duration !== undefined) durations.set(name.trim(), duration);
  }
  const [queue, render, encode] = ["queue", "render", "encode"].map((name) => durations.get(name));
  return queue === undefined || render === undefined || encode === undefined ? null : { queue, render, encode };
}

/** Numbers by name from `a=1, b=2`; other values are skipped. */
function parameters(field: string, separator: string): Map<string, number> {
  const found = new Map<string, number>();
  for (const part of field.split(separator)) {
    const [name, value] = part.split("=");
    const number = Number(value?.trim() || Number.NaN);
    if (name !== undefined && Number.isFinite(number)) found.set(name.trim(), number);
  }
  return found;
}
