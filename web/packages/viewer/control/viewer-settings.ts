/** The settings of a viewer as a type that needs no other package: the declarations spell it out. */
import { DEFAULT_SETTINGS } from "../state/settings";

const written = () => ({ ...DEFAULT_SETTINGS });

export type ViewerSettings = ReturnType<typeof written>;
