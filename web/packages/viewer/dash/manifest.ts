/** The parts of an MPD used by the bare player: representations, and numbered segments of equal length. */

export interface Representation {
  readonly id: string;
  /** Bits per second. */
  readonly bandwidth: number;
  readonly codecs: string;
}

export interface Manifest {
  /** Media time 0 on the server's clock (availabilityStartTime), in Unix milliseconds. */
  readonly start: number;
  /** A segment's duration, in seconds. */
  readonly segment: number;
  readonly firstNumber: number;
  /** URL of the server's clock (UTCTiming). */
  readonly timeUrl: string;
  /** Target latency of the manifest, in milliseconds. */
  readonly target: number;
  /** Lowest bitrate first; never empty. */
  readonly representations: readonly [Representation, ...Representation[]];
  headerUrl(representation: Representation): string;
  segmentUrl(representation: Representation, number: number): string;
}

/** Parses an MPD loaded from `url`. Throws if a required part is missing. */
export function readManifest(xml: string, url: string): Manifest {
  const mpd = new DOMParser().parseFromString(xml, "application/xml");
  const all = (name: string) => [...mpd.getElementsByTagName(name)];
  const text = (name: string, attribute: string): string => {
    const value = all(name)[0]?.getAttribute(attribute);
    if (value === null || value === undefined) throw new Error(`the manifest has no ${name}@${attribute}`);
    return value;
  };
  const template = (attribute: string, values: Readonly<Record<string, string | number>>) => {
    const path = text("SegmentTemplate", attribute).replace(/\$(\w+)\$/g, (_, name: string) => String(values[name]));
    return new URL(path, url).href;
  };
  const [lowest, ...higher] = all("Representation")
    .map((one) => ({
      id: one.getAttribute("id") ?? "",
      bandwidth: Number(one.getAttribute("bandwidth")),
      codecs: one.getAttribute("codecs") ?? "",
    }))
    .sort((a, b) => a.bandwidth - b.bandwidth);
  if (lowest === undefined) throw new Error("the manifest has no representation");
  return {
    start: Date.parse(text("MPD", "availabilityStartTime")),
    segment: Number(text("SegmentTemplate", "duration")) / Number(text("SegmentTemplate", "timescale")),
    firstNumber: Number(text("SegmentTemplate", "startNumber")),
    timeUrl: new URL(text("UTCTiming", "value"), url).href,
    target: Number(text("Latency", "target")),
    representations: [lowest, ...higher],
    headerUrl: ({ id }) => template("initialization", { RepresentationID: id }),
    segmentUrl: ({ id }, number) => template("media", { RepresentationID: id, Number: number }),
  };
}
