/** In place of the viewer's session module: a session that the test has made, instead of one that connects. */
export const visit = { next: {} as object };

export class ViewerSession {
  constructor() {
    // biome-ignore lint/correctness/noConstructorReturn: the test's own session
    return visit.next;
  }
}
