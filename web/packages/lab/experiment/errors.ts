/** Why a run could not be made, in one sentence. */
export class RunFailed extends Error {}
