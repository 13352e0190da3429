#!/usr/bin/env node
// Volumes of STEP files by fringetool beside those of OpenCascade, which the npm package occt-import-js holds with its test files:
//
//     npm install occt-import-js
//     node benches/step_volumes.mjs target/release/fringetool node_modules/occt-import-js/test/testfiles
//
// Both make triangles; volumes may differ by the surface times the sum of the distances of their triangles from it.
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, readdirSync, rmSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { basename, join } from 'node:path';

const [program, folder] = process.argv.slice(2);
const CHORD_MM = 0.01;
const occt = await createRequire(`${process.cwd()}/`)('occt-import-js')();

/** Volume and area of all meshes of a file, mm³ and mm². */
function byOpenCascade(file) {
  const settings = { linearUnit: 'millimeter', linearDeflectionType: 'absolute_value', linearDeflection: CHORD_MM, angularDeflection: 0.05 };
  const sum = { volume: 0, area: 0 };
  for (const mesh of occt.ReadStepFile(new Uint8Array(readFileSync(file)), settings).meshes ?? []) {
    const at = (corner) => mesh.attributes.position.array.slice(3 * corner, 3 * corner + 3);
    for (let i = 0; i < mesh.index.array.length; i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => at(mesh.index.array[i + k]));
      const [u, v] = [b, c].map((p) => p.map((value, axis) => value - a[axis]));
      const cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      sum.area += Math.hypot(...cross) / 2;
      sum.volume += (a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]) / 6;
    }
  }
  return sum;
}

const scratch = mkdtempSync(join(tmpdir(), 'step-'));
const counts = { alike: 0, different: 0, refused: 0 };
for (const name of readdirSync(folder, { recursive: true }).filter((name) => /\.ste?p$/i.test(name)).sort()) {
  const [file, json] = [join(folder, name), join(scratch, 'plan.json')];
  const begin = performance.now();
  try {
    execFileSync(program, ['plan-from-cad', file, '--out', join(scratch, 'plan.toml'), '--least-area', '0.01', '--json', json, '--quiet'], { stdio: ['ignore', 'ignore', 'pipe'] });
  } catch (error) {
    counts.refused += 1;
    console.log(`${basename(name)}: refused: ${error.stderr.toString().trim().split(/\.st(?:e)?p: /i).pop()}`);
    continue;
  }
  const seconds = ((performance.now() - begin) / 1000).toFixed(1);
  const ours = JSON.parse(readFileSync(json));
  const theirs = byOpenCascade(file);
  const limit = theirs.area * (ours.chord_mm + CHORD_MM);
  const alike = Math.abs(ours.volume_mm3 - theirs.volume) <= limit;
  counts[alike ? 'alike' : 'different'] += 1;
  console.log(`${basename(name)}: ${alike ? 'alike' : 'DIFFERENT'}: ${ours.volume_mm3.toFixed(3)} and ${theirs.volume.toFixed(3)} mm³, may differ by ${limit.toFixed(3)}; ${seconds} s`);
  rmSync(join(scratch, 'plan.toml'));
  rmSync(json);
}
rmSync(scratch, { recursive: true });
console.log(counts);
