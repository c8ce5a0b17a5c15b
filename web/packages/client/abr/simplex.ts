/**
 * The point of the probability simplex {x : x ≥ 0, Σx = 1} that is nearest to a point in the Euclidean sense:
 * x = max(y − t, 0) with t such that the sum is 1 (Chen and Ye, "Projection Onto A Simplex", arXiv:1101.6081).
 */
export function projectToSimplex(point: readonly number[]): number[] {
  let sum = 0;
  let threshold = 0;
  for (const [i, value] of point.toSorted((a, b) => b - a).entries()) {
    const candidate = (sum + value - 1) / (i + 1);
    if (candidate >= value) break;
    sum += value;
    threshold = candidate;
  }
  return point.map((value) => Math.max(value - threshold, 0));
}
