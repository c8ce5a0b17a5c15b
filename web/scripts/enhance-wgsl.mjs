// Writes the shaders that the page generates from a file of weights, for `python -m benchmarks.enhance` (docs/enhancement.md).
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { runnerImport } from "vite";

const USAGE = `node scripts/enhance-wgsl.mjs enhance.safetensors FOLDER
  writes FOLDER/shaders.json and its shaders, in half and in single precision
`;

async function load(name) {
  const path = fileURLToPath(new URL(`../src/enhance/network/${name}.ts`, import.meta.url));
  return (await runnerImport(path, { configFile: false, logLevel: "error" })).module;
}

async function main() {
  const [weights, folder] = process.argv.slice(2);
  if (folder === undefined) return process.stdout.write(USAGE);
  const [{ readNetworks, multiplications }, { shaders }] = await Promise.all(["networks", "wgsl"].map(load));
  mkdirSync(folder, { recursive: true });
  const networks = readNetworks(new Uint8Array(readFileSync(weights)).buffer).map((network) => {
    const { rung, width, height, scale, layers } = network;
    const write = (precision) =>
      shaders(network, precision).map(({ code, tile }, i) => {
        const file = `rung${rung}-layer${i}-${precision}.wgsl`;
        writeFileSync(join(folder, file), code);
        return { file, tile };
      });
    return {
      ...{ rung, width, height, scale, channels: layers[0].outputs, multiplications: multiplications(network) },
      layers: { f16: write("f16"), f32: write("f32") },
    };
  });
  writeFileSync(join(folder, "shaders.json"), `${JSON.stringify(networks, null, 1)}\n`);
}

try {
  await main();
} catch (error) {
  process.stderr.write(`${error.message}\n`);
  process.exitCode = 1;
}
