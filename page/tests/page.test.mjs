// The page as a person uses it: keyboard, mouse, touch, a phone's width, links, files.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { describe, it } from 'node:test';
import { difference, hasBrowser, ltm, open, pictureOf, pngBytes, set, settled, state, visit } from './helpers.mjs';

/** Where pictures of the page go, if they are wanted. */
const SHOTS = process.env.LTM_SHARE_SHOTS;

describe('the page', { skip: !hasBrowser }, () => {
  const visited = visit();

  const loaded = async (options, fragment = '') => {
    const page = await open(visited.browser, `${visited.server.url}?compute=webgl2${fragment}`, options);
    await state(page, 'complete');
    return page;
  };
  const shot = (page, name) => (SHOTS ? page.screenshot({ path: `${SHOTS}/${name}.png` }) : null);
  const focused = (page) => page.evaluate(() => document.activeElement.getAttribute('aria-label') ?? document.activeElement.textContent);

  it('is used by the keyboard alone', async () => {
    const page = await loaded();
    const before = await pictureOf(page);
    const seen = [];
    for (let i = 0; i < 40; i++) {
      await page.keyboard.press('Tab');
      seen.push(await focused(page));
      if (seen.at(-1) === 'lamp_1, stops') break;
    }
    assert.ok(seen[0].startsWith('Picture: arrow keys') && seen.includes('Evening'), seen.join(' | '));
    for (let i = 0; i < 20; i++) await page.keyboard.press('ArrowLeft');
    await settled(page);
    assert.equal(await page.locator('input[aria-label="lamp_1, stops"]').inputValue(), '-1');
    assert.ok(difference(await pictureOf(page), before).mean > 0.5);
    await page.keyboard.press('Control+z');
    await settled(page);
    // Every step of a key was one of undoing.
    assert.notEqual(await page.locator('input[aria-label="lamp_1, stops"]').inputValue(), '-1');
    await page.keyboard.press('/');
    assert.equal(await focused(page), 'Find a light');
    await page.keyboard.type('sky');
    assert.deepEqual(await page.locator('#lights .name:visible').allTextContents(), ['sky']);
    // The cross in the middle reads the picture.
    await page.locator('#stage').focus();
    await page.keyboard.press('ArrowUp');
    await page.waitForFunction(() => /cd\/m².*lx/.test(document.getElementById('probe').textContent));
    await shot(page, 'keyboard');
    await page.context().close();
  });

  it('reads the picture in its units', async () => {
    const page = await loaded();
    await page.evaluate(() => document.getElementById('stage').dispatchEvent(new PointerEvent('pointermove', {
      clientX: document.getElementById('picture').getBoundingClientRect().left + 0.5 + (75.5 / 150) * document.getElementById('picture').getBoundingClientRect().width,
      clientY: document.getElementById('picture').getBoundingClientRect().top + (90.5 / 100) * document.getElementById('picture').getBoundingClientRect().height,
    })));
    await page.waitForFunction(() => document.getElementById('probe').textContent.startsWith('75, 90'));
    const text = await page.locator('#probe').textContent();
    const [candela, lux] = text.match(/([\d.]+) cd\/m².*?([\d.]+) lx/).slice(1).map(Number);
    const rgb = text.split('\n')[1].split(/\s+/).map(Number);
    const expected = 179 * (0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]);
    assert.ok(Math.abs(candela / expected - 1) < 0.02 && Math.abs(lux / candela / Math.PI - 1) < 0.02, text);
    // And it is the pixel that is shown, which is held against the relighter's elsewhere.
    const gain = 2 ** Number(await page.evaluate(() => document.getElementById('exposure').value));
    const encoded = rgb.map((v) => Math.min(v * gain, 1)).map((v) => 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
    const shown = (await pictureOf(page)).subarray(4 * (90 * 150 + 75), 4 * (90 * 150 + 75) + 3);
    assert.ok(encoded.every((v, ch) => Math.abs(v - shown[ch]) <= 2), `${encoded} ${Array.from(shown)}`);
    await page.context().close();
  });

  it('keeps a mix in its link', async () => {
    const page = await loaded();
    await page.getByRole('button', { name: 'Evening' }).click();
    await set(page, 'input[aria-label="panel, stops"]', 1.5);
    await set(page, '#curve', 1);
    await set(page, '#exposure', 2);
    await settled(page);
    const picture = await pictureOf(page);
    await page.waitForFunction(() => location.hash.length > 20);
    await page.waitForTimeout(600);
    const fragment = new URL(page.url()).hash;
    const again = await loaded({}, fragment);
    await settled(again);
    assert.equal(await again.locator('input[aria-label="panel, stops"]').inputValue(), '1.5');
    const apart = difference(await pictureOf(again), picture);
    // A pattern in a link has 8 bits.
    assert.ok(apart.largest <= 6 && apart.mean < 0.2, JSON.stringify(apart));
    const odd = await loaded({}, '#bm9uc2Vuc2U');
    assert.deepEqual(odd.complaints, []);
    for (const tab of [page, again, odd]) await tab.context().close();
  });

  it('solo, groups and switches do what they say', async () => {
    const page = await loaded();
    const press = (name) => page.getByRole('button', { name, exact: true }).click();
    const mean = async () => {
      await settled(page);
      const bytes = await pictureOf(page);
      return bytes.reduce((sum, byte, i) => sum + (i % 4 < 3 ? byte : 0), 0) / bytes.length;
    };
    const all = await mean();
    await press('Solo lamp_2');
    const solo = await mean();
    assert.ok(solo < all);
    await press('On: group ceiling');
    assert.equal(await mean(), 0, 'the only light that is heard is in a group that is off');
    await press('Reset');
    assert.equal(await mean(), all);
    await set(page, 'input[aria-label="Group ceiling, stops"]', -8);
    const dim = await mean();
    assert.ok(dim < all && dim > 0);
    await press('Undo');
    assert.equal(await mean(), all);
    await page.context().close();
  });

  it('paints a panel, turns a sky, colours a lamp', async () => {
    const page = await loaded();
    const before = await pictureOf(page);
    await page.getByRole('button', { name: 'Colour of panel' }).click();
    const texels = page.getByRole('application', { name: /^panel, 6 by 4 texels/ });
    await texels.focus();
    await page.keyboard.press('ArrowLeft');
    await page.keyboard.press('Space');
    await settled(page);
    const painted = await pictureOf(page);
    assert.ok(difference(painted, before).mean > 0.01);
    const box = await texels.boundingBox();
    await page.mouse.move(box.x + 5, box.y + 5);
    await page.mouse.down();
    await page.mouse.move(box.x + box.width - 5, box.y + 5, { steps: 8 });
    await page.mouse.up();
    await settled(page);
    assert.ok(difference(await pictureOf(page), painted).mean > 0.01);
    await page.getByRole('button', { name: 'Colour of lamp_1' }).click();
    await page.getByLabel('lamp_1, kind of colour').selectOption('kelvin');
    await set(page, 'input[aria-label="lamp_1, kelvin"]', 2000);
    await settled(page);
    await page.getByRole('button', { name: 'Colour of sky' }).click();
    const sky = page.getByRole('application', { name: /^sky/ });
    await sky.focus();
    for (const key of ['ArrowUp', 'Space', 'ArrowLeft', 'Space']) await page.keyboard.press(key);
    await settled(page);
    const unturned = await pictureOf(page);
    await set(page, 'input[aria-label="sky, turned, degrees"]', 90);
    await settled(page);
    assert.ok(difference(await pictureOf(page), unturned).mean > 0.001);
    await shot(page, 'texels');
    assert.deepEqual(page.complaints, []);
    await page.context().close();
  });

  it('compares two mixes by a wipe', async () => {
    const page = await loaded();
    const now = await pictureOf(page);
    await page.getByLabel('Compare with').selectOption({ label: 'Evening' });
    await settled(page);
    const both = await pictureOf(page);
    const isLeft = (_, i) => (i / 4) % 150 < 75;
    const isRight = (_, i) => (i / 4) % 150 >= 75;
    assert.deepEqual(both.filter(isRight), now.filter(isRight));
    assert.ok(difference(both.filter(isLeft), now.filter(isLeft)).mean > 5);
    await shot(page, 'wipe');
    const line = await page.locator('#line').boundingBox();
    await page.mouse.move(line.x + 1, line.y + 100);
    await page.mouse.down();
    await page.mouse.move(line.x + 201, line.y + 100);
    await page.mouse.up();
    assert.ok(Number(await page.locator('#wipe').inputValue()) > 0.6);
    await set(page, '#wipe', 0);
    await settled(page);
    assert.deepEqual(await pictureOf(page), now);
    await page.context().close();
  });

  it('gives a PNG of the full size', async () => {
    const page = await loaded();
    const waiting = page.waitForEvent('download');
    await page.getByRole('button', { name: 'PNG' }).click();
    const download = await waiting;
    assert.equal(download.suggestedFilename(), 'Test room.png');
    assert.deepEqual(await pngBytes(visited.browser, await download.path()), await pictureOf(page));
    await page.context().close();
  });

  it('moves and zooms by mouse and touch', async () => {
    const page = await loaded();
    const place = () => page.evaluate(() => document.getElementById('picture').style.transform);
    const fitted = await place();
    await page.mouse.move(400, 300);
    await page.mouse.wheel(0, -300);
    await page.waitForFunction((was) => document.getElementById('picture').style.transform !== was, fitted);
    await page.keyboard.press('1');
    assert.match(await place(), /scale\(1\)/);
    await page.mouse.down();
    await page.mouse.move(450, 340);
    await page.mouse.up();
    await page.keyboard.press('f');
    assert.equal(await place(), fitted);
    await page.context().close();
  });

  for (const [name, options] of Object.entries({
    phone: { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 3, colorScheme: 'dark' },
    desk: { viewport: { width: 1440, height: 900 }, colorScheme: 'light' },
  })) {
    it(`fits a ${name}`, async () => {
      const page = await loaded(options);
      const { scroll, client } = await page.evaluate(() => ({ scroll: document.documentElement.scrollWidth, client: document.documentElement.clientWidth }));
      assert.ok(scroll <= client, `${scroll} pixels on ${client}`);
      // Everything that can be touched is within reach.
      const outside = await page.evaluate(() => Array.from(document.querySelectorAll('button, input, select'))
        .filter((element) => element.offsetParent && (element.getBoundingClientRect().right > innerWidth + 1 || element.getBoundingClientRect().left < -1))
        .map((element) => element.id || element.getAttribute('aria-label')));
      assert.deepEqual(outside, []);
      await shot(page, name);
      if (options.hasTouch) {
        await page.locator('#stage').tap({ position: { x: 195, y: 200 } });
        await page.waitForFunction(() => /cd\/m²/.test(document.getElementById('probe').textContent));
        await page.locator('#panel').evaluate((panel) => panel.lastElementChild.previousElementSibling.scrollIntoView());
        await shot(page, `${name}-scrolled`);
      }
      await page.context().close();
    });
  }

  it('writes a page that every control of has a name', async () => {
    const page = await loaded();
    const nameless = await page.evaluate(() => Array.from(document.querySelectorAll('button, input, select, canvas:not([aria-hidden])'))
      .filter((element) => !(element.getAttribute('aria-label') || element.textContent.trim() || element.labels?.length))
      .map((element) => element.outerHTML));
    assert.deepEqual(nameless, []);
    await page.context().close();
    assert.ok(readFileSync(visited.made.at('site/index.html'), 'utf8').includes("default-src 'none'"));
    assert.match(ltm('share', '--help'), /--single/);
  });
});
