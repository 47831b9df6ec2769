// Every way to compute, against the CPU relighter: pixel by pixel.

import assert from 'node:assert/strict';
import { describe, it } from 'node:test';
import { difference, hasBrowser, ltm, open, pictureOf, pngBytes, set, settled, state, visit } from './helpers.mjs';

/** No byte differs by more than this many steps of 255, and few by more than one: the relighter keeps factors in 8 bits where
 * their quantisation allows it, which shows in what is dark; the page keeps them as they were decoded, or in 16 bits. */
const MOST_STEPS = 8;
const MOST_FAR = 0.01;
const CURVES = ['none', 'agx', 'filmic', 'neutral'];

describe('pictures', { skip: !hasBrowser }, () => {
  const visited = visit();

  const reference = (name, options) => {
    const path = visited.made.at(`${name}.png`);
    ltm('relight', visited.made.at('room.ltc'), '-o', path, '--device', 'cpu', ...options);
    return pngBytes(visited.browser, path);
  };
  const isNear = (found, expected, what) => {
    const apart = difference(found.filter((_, i) => i % 4 < 3), expected.filter((_, i) => i % 4 < 3));
    assert.ok(apart.lengths[0] === apart.lengths[1] && apart.largest <= MOST_STEPS && apart.far <= MOST_FAR, `${what}: ${JSON.stringify(apart)}`);
  };

  for (const way of ['worker', 'webgl2', 'webgpu']) {
    it(`${way} makes the relighter's picture`, async (test) => {
      const page = await open(visited.browser, `${visited.server.url}?compute=${way}`);
      await state(page, 'complete');
      const taken = await page.evaluate(() => document.body.dataset.way);
      if (taken !== way) return test.skip(`this browser has no ${way}: it took ${taken}`);
      const exposure = await page.evaluate(() => document.getElementById('exposure').value);
      await set(page, '#exposure', exposure);
      for (const [index, curve] of CURVES.entries()) {
        await set(page, '#curve', index);
        await settled(page);
        isNear(await pictureOf(page), await reference(curve, ['--tone', curve, '--exposure', exposure]), `${way}, ${curve}`);
      }
      // A look with one lamp at half, and a shape on the panel.
      await set(page, '#curve', 0);
      await page.getByRole('button', { name: 'Evening' }).click();
      await settled(page);
      const look = ['--lighting', visited.made.looks, '--look', 'Evening', '--exposure', exposure];
      isNear(await pictureOf(page), await reference('evening', look), `${way}, a look`);
      // And back again: sums that are added up do not drift.
      for (let i = 0; i < 20; i++) await set(page, '#lights input[type=range]', (i % 5) - 2);
      await page.getByRole('button', { name: 'Evening' }).click();
      await settled(page);
      isNear(await pictureOf(page), await reference('evening', look), `${way}, a look after many moves`);
      assert.deepEqual(page.complaints, []);
      await page.context().close();
    });
  }

  it('goes on with workers where the GPU is lost', async () => {
    const page = await open(visited.browser, 'about:blank');
    await page.addInitScript(() => {
      const { getContext } = HTMLCanvasElement.prototype;
      HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
        const context = getContext.call(this, kind, ...rest);
        if (kind === 'webgl2') (window.contexts ??= []).push(context);
        return context;
      };
    });
    await page.goto(`${visited.server.url}?compute=webgl2`);
    await state(page, 'complete');
    const before = await pictureOf(page);
    await page.evaluate(() => window.contexts.forEach((gl) => gl.getExtension('WEBGL_lose_context').loseContext()));
    await page.waitForFunction(() => document.body.dataset.way === 'worker');
    await set(page, '#curve', 1);
    await set(page, '#curve', 0);
    await settled(page);
    const apart = difference(await pictureOf(page), before);
    assert.ok(apart.largest <= 2, JSON.stringify(apart));
    await page.context().close();
  });
});
