// @vitest-environment happy-dom
import { cleanup, render, screen } from "@testing-library/preact";
import { afterEach, expect, test } from "vitest";
import { lazy } from "./lazy";

afterEach(cleanup);

const Greeting = ({ name }: { readonly name: string }) => <p>Hello, {name}</p>;

test("a part is loaded when it is first shown, and is there at once from then on", async () => {
  let loads = 0;
  const Part = lazy(async () => {
    loads++;
    return Greeting;
  });
  expect(loads).toBe(0);
  render(<Part name="Ada" />);
  expect(screen.getByRole("status").textContent).toBe("Loading…");
  await screen.findByText("Hello, Ada");
  cleanup();
  render(<Part name="Grace" />);
  expect(screen.getByText("Hello, Grace")).toBeTruthy();
});

test("a part that cannot be loaded says so, and is loaded when it is shown again", async () => {
  let answers = false;
  const Part = lazy(async () => {
    if (!answers) throw new TypeError("Failed to fetch dynamically imported module");
    return Greeting;
  });
  render(<Part name="Ada" />);
  await screen.findByText("This part of the page could not be loaded. Reload the page to try again.");
  cleanup();
  answers = true;
  render(<Part name="Ada" />);
  await screen.findByText("Hello, Ada");
});
