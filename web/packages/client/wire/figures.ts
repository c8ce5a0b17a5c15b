// Generated from services/experiments/tigas_experiments/wire/figures.py by `npm run wire`. Do not edit.

export const INTERACTIVE_MS = 108;
export const USUAL_INTERVAL_MS = 16.666666666666668;
export const AGE_EVERY_MS = 5;
