/** This browser cannot play DASH. */
import { StreamUnsupported } from "../stream/stream";

export class NoMediaSource extends StreamUnsupported {
  constructor() {
    super("This browser cannot play DASH streams: it has no Media Source Extensions.");
  }
}
