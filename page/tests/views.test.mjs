// Several views on one page: tabs under one mix.

import assert from 'node:assert/strict';
import { readFileSync, writeFileSync } from 'node:fs';
import { describe, it, before, after } from 'node:test';
import { fileURLToPath } from 'node:url';
import { difference, hasBrowser, launch, ltm, open, pictureOf, pngBytes, room, serve, set, settled, state } from './helpers.mjs';

const HERE = fileURLToPath(new URL('.', import.meta.url));

describe('several views', { skip: !hasBrowser }, () => {
  let [browser, server, made, files] = [];

  before(async () => {
    made = room();
    // The same room from its side, with a lamp that the other view's container does not have.
    for (const name of ['room.obj', 'room.mtl']) writeFileSync(made.at(name), readFileSync(`${HERE}room/${name}`));
    const scene = readFileSync(`${HERE}room/room.toml`, 'utf8').replace('eye = [0.0, 1.0, 3.0]', 'eye = [0.7, 1.2, 2.6]')
      .replace('width = 150', 'width = 120').concat('\n[[light]]\nname = "spare"\nkind = "point"\nposition = [0.3, 0.5, 0.5]\nemission = [1.0, 1.0, 1.0]\n');
    writeFileSync(made.at('side.toml'), scene);
    ltm('render', made.at('side.toml'), '--pack', '-o', made.at('side.ltc'));
    ltm('share', made.at('room.ltc'), made.at('side.ltc'), '-o', made.at('two'), '--lighting', made.looks);
    ltm('share', made.at('room.ltc'), made.at('side.ltc'), '-o', made.at('two.html'), '--single', '--lighting', made.looks);
    files = {
      page: readFileSync(made.at('two/index.html')), data: readFileSync(made.at('two/picture.lts')),
      more: { '/picture-2.lts': readFileSync(made.at('two/picture-2.lts')) },
    };
    [browser, server] = [await launch(), await serve(files)];
  });

  after(async () => {
    await browser?.close();
    server?.close();
  });

  const loaded = async (url = server.url) => {
    const page = await open(browser, `${url}?compute=webgl2`);
    await state(page, 'complete');
    // As the slider has it, which goes by steps.
    await set(page, '#exposure', await page.evaluate(() => document.getElementById('exposure').value));
    return page;
  };
  const show = async (page, name) => {
    await page.getByRole('button', { name, exact: true }).click();
    await page.waitForFunction((name) => document.body.dataset.view === name, name);
    await settled(page);
  };
  const isLit = async (page, name, options) => {
    const exposure = await page.evaluate(() => document.getElementById('exposure').value);
    ltm('relight', made.at(`${name}.ltc`), '-o', made.at('expected.png'), '--device', 'cpu', '--exposure', exposure, ...options);
    const rgb = (bytes) => bytes.filter((_, i) => i % 4 < 3);
    const apart = difference(rgb(await pictureOf(page)), rgb(await pngBytes(browser, made.at('expected.png'))));
    assert.ok(apart.lengths[0] === apart.lengths[1] && apart.largest <= 8 && apart.far <= 0.01, `${name} ${options}: ${JSON.stringify(apart)}`);
  };

  it('are lit by one mix, which is undone in any of them', async () => {
    const page = await loaded();
    await page.getByRole('button', { name: 'Evening' }).click();
    await settled(page);
    const evening = ['--lighting', made.looks, '--look', 'Evening'];
    await isLit(page, 'room', evening);
    await show(page, 'side');
    await isLit(page, 'side', evening);
    await page.keyboard.press('Control+z');
    await settled(page);
    await isLit(page, 'side', []);
    await page.keyboard.press('v');
    await settled(page);
    await isLit(page, 'room', []);
    // Solo on a light that this view lacks leaves it dark.
    await show(page, 'side');
    await page.getByRole('button', { name: 'Solo spare' }).click();
    await settled(page);
    await show(page, 'room');
    assert.ok((await pictureOf(page)).every((byte, i) => i % 4 === 3 || byte === 0));
    assert.deepEqual(page.complaints, []);
    await page.context().close();
  });

  it('list their own lights and stand where they stood', async () => {
    const page = await loaded();
    const names = () => page.locator('#lights .name:visible').allTextContents();
    const place = () => page.evaluate(() => document.getElementById('picture').style.transform);
    assert.ok(!(await names()).includes('spare'));
    await page.keyboard.press('1');
    const stood = await place();
    await show(page, 'side');
    assert.ok((await names()).includes('spare') && (await place()) !== stood);
    await page.keyboard.press('V');
    await settled(page);
    assert.equal(await place(), stood);
    await page.context().close();
  });

  it('are read when they are shown, and a link says which', async () => {
    const page = await loaded();
    await set(page, 'input[aria-label="panel, stops"]', -2);
    await show(page, 'side');
    const picture = await pictureOf(page);
    await page.waitForFunction(() => location.hash.length > 20);
    await page.waitForTimeout(600);
    const again = await open(browser, `${server.url}?compute=webgl2${await page.evaluate(() => location.hash)}`);
    await again.waitForFunction(() => document.body.dataset.view === 'side');
    await settled(again);
    assert.ok(difference(await pictureOf(again), picture).largest <= 1);
    await page.context().close();
    await again.context().close();
  });

  it('stand in one file too', async () => {
    const page = await loaded(`file://${made.at('two.html')}`);
    await show(page, 'side');
    await isLit(page, 'side', []);
    assert.deepEqual(page.complaints, []);
    await page.context().close();
  });

  it('say which of them cannot be shown', async () => {
    const own = await serve({ ...files, more: {} });
    const page = await open(browser, `${own.url}?compute=webgl2`);
    await state(page, 'complete');
    assert.match(await page.locator('#damage').textContent(), /A view cannot be shown: the server answers 404/);
    await page.context().close();
    own.close();
  });
});
