/** The form for a constant link: converts typed text into a setting, or into error messages. */
import type { LinkSetting } from "#client/wire/shaper";

export const LINK_FIELDS = [
  { name: "down", label: "Down", unit: "Mbit/s", max: 100_000 },
  { name: "up", label: "Up", unit: "Mbit/s", max: 100_000 },
  { name: "rtt", label: "Round trip", unit: "ms", max: 120_000 },
  { name: "jitter", label: "Jitter", unit: "ms", max: 60_000 },
  { name: "loss", label: "Loss", unit: "%", max: 100 },
] as const;

export type LinkField = (typeof LINK_FIELDS)[number]["name"];
export type LinkDraft = Readonly<Record<LinkField, string>>;
export type LinkProblems = Readonly<Partial<Record<LinkField, string>>>;

const NUMBER = /^[+-]?(\d+([.,]\d*)?|[.,]\d+)$/;

export function draftOf({ down_kbps, up_kbps, delay_ms = 0, jitter_ms = 0, loss_pct = 0 }: LinkSetting): LinkDraft {
  return {
    down: text(down_kbps / 1000),
    up: text(up_kbps / 1000),
    rtt: text(delay_ms * 2),
    jitter: text(jitter_ms),
    loss: text(loss_pct),
  };
}

/** The setting, or the errors by field. The round trip is the delay of both directions; jitter applies to each. */
export function parseLink(draft: LinkDraft): { setting: LinkSetting } | { problems: LinkProblems } {
  const values: Partial<Record<LinkField, number>> = {};
  const problems: Partial<Record<LinkField, string>> = {};
  for (const { name, label, unit, max } of LINK_FIELDS) {
    const typed = draft[name].trim();
    const value = NUMBER.test(typed) ? Number(typed.replace(",", ".")) : Number.NaN;
    if (value >= 0 && value <= max) values[name] = value;
    else problems[name] = `${label} must be a number from 0 to ${max.toLocaleString("en")} ${unit}.`;
  }
  const { down, up, rtt, jitter, loss } = values;
  if (down === undefined || up === undefined || rtt === undefined) return { problems };
  if (jitter === undefined || loss === undefined) return { problems };
  return {
    setting: { down_kbps: down * 1000, up_kbps: up * 1000, delay_ms: rtt / 2, jitter_ms: jitter, loss_pct: loss },
  };
}

function text(value: number): string {
  return String(Number(value.toFixed(3)));
}
