/** Formats numbers for display. */

/** Shown for an unknown figure. */
export const NONE = "–";

/** 1,234 → "1.2 k", 2,345,678 → "2.3 M". */
export function count(value: number): string {
  if (value < 1000) return String(value);
  return value < 999_500 ? `${significant(value / 1e3)} k` : `${significant(value / 1e6)} M`;
}

/** Bytes in decimal units: "512 B", "57 MB", "1.2 GB". */
export function bytes(value: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  const power = value < 1 ? 0 : Math.min(units.length - 1, Math.floor(Math.log10(value) / 3));
  const scaled = value / 1000 ** power;
  return `${power === 0 ? value : significant(scaled)} ${units[power]}`;
}

/** Bits per second: "850 kbit/s", "24 Mbit/s". */
export function bitrate(value: number): string {
  if (value < 1e6) return `${Math.round(value / 1e3)} kbit/s`;
  return value < 1e9 ? `${significant(value / 1e6)} Mbit/s` : `${significant(value / 1e9)} Gbit/s`;
}

/** Two significant digits below ten, whole numbers above. */
function significant(value: number): string {
  return value < 9.95 ? String(Math.round(value * 10) / 10) : String(Math.round(value));
}

/** Without the unit. */
export function milliseconds(value: number | null | undefined): string {
  if (value === null || value === undefined) return NONE;
  return value < 10 ? value.toFixed(1) : String(Math.round(value));
}

/** Milliseconds as a clock: "0:07", "12:30", "1:02:03". */
export function clock(milliseconds: number): string {
  const total = Math.floor(milliseconds / 1000);
  const [hours, minutes, seconds] = [Math.floor(total / 3600), Math.floor(total / 60) % 60, total % 60];
  const tail = String(seconds).padStart(2, "0");
  return hours ? `${hours}:${String(minutes).padStart(2, "0")}:${tail}` : `${minutes}:${tail}`;
}
