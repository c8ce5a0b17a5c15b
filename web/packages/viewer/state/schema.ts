/** Checks of values that come from outside, such as stored settings: only as much as the first screen needs. */

export interface Schema<T> {
  readonly accepts: (value: unknown) => value is T;
  /** The values as text, if they can be listed. */
  readonly choices?: readonly string[];
}

export type ValueOf<S> = S extends Schema<infer T> ? T : never;

export const BOOLEAN: Schema<boolean> = {
  accepts: (value) => typeof value === "boolean",
  choices: ["on", "off"],
};

export function oneOf<const T extends string | number>(values: readonly T[]): Schema<T> {
  return {
    accepts: (value): value is T => values.includes(value as T),
    choices: values.map(String),
  };
}

export function numberWithin(min: number, max: number): Schema<number> {
  return { accepts: (value): value is number => typeof value === "number" && value >= min && value <= max };
}

export function wholeWithin(min: number, max: number): Schema<number> {
  const { accepts } = numberWithin(min, max);
  return { accepts: (value): value is number => accepts(value) && Number.isInteger(value) };
}

export function nullable<T>({ accepts }: Schema<T>): Schema<T | null> {
  return { accepts: (value): value is T | null => value === null || accepts(value) };
}

export function either<A, B>(one: Schema<A>, other: Schema<B>): Schema<A | B> {
  return { accepts: (value): value is A | B => one.accepts(value) || other.accepts(value) };
}

/** An object with exactly these properties. */
export function record<T extends object>(shape: { readonly [Name in keyof T]: Schema<T[Name]> }): Schema<T> {
  const schemas = Object.entries<Schema<unknown>>(shape);
  return {
    accepts: (value): value is T => {
      if (typeof value !== "object" || value === null) return false;
      const given = value as Readonly<{ [name: string]: unknown }>;
      return (
        Object.keys(given).every((name) => name in shape) &&
        schemas.every(([name, schema]) => schema.accepts(given[name]))
      );
    },
  };
}
