// @vitest-environment happy-dom
import { expect, test } from "vitest";
import { readManifest } from "./manifest";

const MPD = `<?xml version="1.0" encoding="utf-8"?>
<MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="dynamic" availabilityStartTime="2026-01-31T12:00:00.250Z">
  <ServiceDescription id="0"><Latency target="60" min="30" max="180" referenceId="0" /></ServiceDescription>
  <Period id="0" start="PT0S"><AdaptationSet id="0" contentType="video">
    <SegmentTemplate timescale="30000" duration="15000" startNumber="1" availabilityTimeOffset="0.466667"
      initialization="$RepresentationID$/init.mp4" media="$RepresentationID$/$Number$.m4s" />
    <Representation id="r2-4242" bandwidth="4242000" codecs="avc1.42c01e" width="640" height="360" />
    <Representation id="r3-500" bandwidth="500000" codecs="avc1.42c00d" width="320" height="180" />
  </AdaptationSet></Period>
  <UTCTiming schemeIdUri="urn:mpeg:dash:utc:http-xsdate:2014" value="http://packager/time" />
</MPD>`;

test("it says where each segment is, and when", () => {
  const manifest = readManifest(MPD, "http://packager/sessions/a/manifest.mpd");
  expect(manifest).toMatchObject({
    start: Date.UTC(2026, 0, 31, 12, 0, 0, 250),
    segment: 0.5,
    firstNumber: 1,
    timeUrl: "http://packager/time",
    target: 60,
  });
  const [lowest, best] = manifest.representations;
  expect(lowest).toEqual({ id: "r3-500", bandwidth: 500_000, codecs: "avc1.42c00d" });
  expect(best?.id).toBe("r2-4242");
  expect(manifest.headerUrl(lowest)).toBe("http://packager/sessions/a/r3-500/init.mp4");
  expect(manifest.segmentUrl(lowest, 12)).toBe("http://packager/sessions/a/r3-500/12.m4s");
});

test("what is missing is named", () => {
  const read = (xml: string) => () => readManifest(xml, "http://packager/a.mpd");
  expect(read(MPD.replace(/<UTCTiming.*>/, ""))).toThrow("the manifest has no UTCTiming@value");
  expect(read(MPD.replace(/<Representation .*>/g, ""))).toThrow("the manifest has no representation");
  expect(read("<html></html>")).toThrow("the manifest has no");
});
