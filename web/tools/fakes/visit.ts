/** Replaces the viewer's session module with a session made by the test, which does not connect. */
export const visit = { next: {} as object };

export class ViewerSession {
  constructor() {
    // biome-ignore lint/correctness/noConstructorReturn: the test's session
    return visit.next;
  }
}
