// What a page costs: `node measure.mjs SITE`. Bytes and milliseconds to a first picture at 1 MB/s, and from a moved fader to its
// picture by each way to compute. The browser's GPUs are software, so that times on them say little of real ones.

import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { launch, open, serve, set, settled, state } from './tests/helpers.mjs';

const [site, shots] = process.argv.slice(2);
const [page, data] = ['index.html', 'picture.lts'].map((name) => readFileSync(join(site, name)));
const head = new DataView(data.buffer, data.byteOffset).getUint32(12, true);
console.log(`page ${page.length} B, data ${data.length} B, of them the head ${head} B`);
const browser = await launch();
const slow = await serve({ page, data, bytesPerSec: 1_000_000 });
const tab = await open(browser, slow.url);
for (const name of ['preview', 'base', 'complete']) {
  await state(tab, ...{ preview: ['preview', 'base', 'complete'], base: ['base', 'complete'], complete: ['complete'] }[name]);
  if (shots) await tab.screenshot({ path: join(shots, `${name}.png`) });
}
const marks = await tab.evaluate(() => performance.getEntriesByType('mark').map(({ name, startTime }) => `${name} ${startTime.toFixed(0)} ms`));
console.log(`at 1 MB/s: ${marks.join(', ')}`);
await tab.context().close();
slow.close();
const server = await serve({ page, data });
for (const way of ['webgpu', 'webgl2', 'worker']) {
  const tab = await open(browser, `${server.url}?compute=${way}`);
  await state(tab, 'complete');
  const times = [];
  for (let i = 0; i < 20; i++) {
    // Reading a pixel back makes sure that the picture is there.
    times.push(await tab.evaluate(async (i) => {
      const before = document.body.dataset.pictures;
      const range = document.querySelector('#lights input[type=range]');
      const begun = performance.now();
      range.value = String((i % 7) - 3);
      range.dispatchEvent(new Event('input', { bubbles: true }));
      while (document.body.dataset.pictures === before) await new Promise((resolve) => requestAnimationFrame(resolve));
      document.getElementById('picture').getContext('2d').getImageData(0, 0, 1, 1);
      return performance.now() - begun;
    }, i));
    await settled(tab);
  }
  times.sort((a, b) => a - b);
  const taken = await tab.evaluate(() => document.body.dataset.way);
  console.log(`${way}${taken === way ? '' : ` (took ${taken})`}: fader to picture ${times[10].toFixed(1)} ms in the middle, ${times[18].toFixed(1)} ms at 95 %`);
  await tab.context().close();
}
await browser.close();
server.close();
