// Generated from services/experiments/tigas_experiments/wire/movement.py by `npm run wire`. Do not edit.

export const ANCHORS = ["start", "scene"] as const;
export const UNITS = ["m", "scene"] as const;
export const COLUMNS = ["t_ms", "x", "y", "z", "qx", "qy", "qz", "qw"] as const;
export const MAX_DURATION_MS = 86400000;
export const MAX_COORDINATE = 1000000;
export const QUATERNION_LENGTHS = [0.1, 10] as const;
export const VIEW_M = 4;
