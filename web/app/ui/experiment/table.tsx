/** Tables of experiments, runs and samples. */
import type { ComponentChildren } from "preact";

interface Props {
  /** Headings; null for the column of actions. */
  readonly columns: readonly (string | null)[];
  readonly children: ComponentChildren;
}

export function Table({ columns, children }: Props) {
  return (
    <div class="experiment-list">
      <table>
        <thead class="muted">
          <tr>
            {columns.map((name) => (
              <th key={name} scope="col">
                {name ?? <span class="visually-hidden">Actions</span>}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>{children}</tbody>
      </table>
    </div>
  );
}

export function dateOf(time: string | number): string {
  return new Date(time).toLocaleString("en", { dateStyle: "medium", timeStyle: "short" });
}
