// Runs a program of the simulator (tools/simulator/programs) by its name and arguments.
import { fileURLToPath } from "node:url";
import { runnerImport } from "vite";

const [name] = process.argv.splice(2, 1); // keeps the arguments
const path = fileURLToPath(new URL(`../tools/simulator/programs/${name}.ts`, import.meta.url));
try {
  const config = { configFile: false, logLevel: "error", resolve: { tsconfigPaths: true } };
  await runnerImport(path, config);
} catch (error) {
  process.stderr.write(`${error.message}\n`);
  process.exitCode = 1;
}
