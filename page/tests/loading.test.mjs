// How the data come: ranges or none, slowly, cut short, damaged, from a disk; and what the page says of it.

import assert from 'node:assert/strict';
import { after, before, describe, it } from 'node:test';
import { pathToFileURL } from 'node:url';
import { inflateRawSync } from 'node:zlib';
import { difference, hasBrowser, launch, open, pictureOf, room, serve, settled, state } from './helpers.mjs';

describe('loading', { skip: !hasBrowser }, () => {
  let browser, made, head, rest, whole;
  before(async () => {
    made = room();
    browser = await launch();
    const { data } = made;
    rest = 20 + data.readUInt32LE(12);
    head = JSON.parse(inflateRawSync(data.subarray(20, rest)).toString());
    const server = await serve(made);
    const page = await open(browser, server.url);
    await state(page, 'complete');
    whole = await pictureOf(page);
    await page.context().close();
    server.close();
  });
  after(() => browser?.close());

  /** A page that was loaded to its end. */
  const loaded = async (options, ...states) => {
    const server = await serve({ ...made, whole: made.data, ...options });
    const page = await open(browser, server.url);
    await state(page, ...states);
    server.close();
    return { page, asked: server.asked, damage: await page.evaluate(() => document.getElementById('damage').textContent) };
  };
  /** The data with one byte of the first chunk of a layer changed. */
  const flipped = (level, layer) => {
    const { offset, indexBytes } = head.levels[level].layers[layer];
    const data = Buffer.from(made.data);
    data[rest + offset + indexBytes + 3] ^= 0x10;
    return data;
  };

  it('reads a room with steps for each band of right sides and each zone of left ones', () => {
    const { offset, indexBytes } = head.levels[1].layers[1];
    assert.equal(made.data[rest + offset + indexBytes], 5);
  });

  it('asks for the page and its data, and nothing else', async () => {
    const { page, asked } = await loaded({}, 'complete');
    assert.deepEqual(asked.map(({ path }) => path), ['/', '/picture.lts']);
    assert.deepEqual(page.complaints, []);
    await page.context().close();
  });

  it('loads from a server without ranges', async () => {
    const { page, damage } = await loaded({ ranges: false }, 'complete');
    assert.equal(damage, '');
    assert.deepEqual(await pictureOf(page), whole);
    await page.context().close();
  });

  it('shows the whole picture early on a slow network, and refines it', async () => {
    const server = await serve({ ...made, bytesPerSec: made.data.length / 12 });
    const page = await open(browser, server.url);
    await state(page, 'preview', 'base');
    const early = await pictureOf(page);
    assert.ok(early.every((byte, i) => i % 4 < 3 || byte === 255), 'every pixel is there');
    await state(page, 'complete');
    const { mean } = difference(early, whole);
    assert.ok(mean > 0.01 && mean < 20, `the first picture is coarser, by ${mean} steps in the mean`);
    assert.deepEqual(await pictureOf(page), whole);
    server.close();
    await page.context().close();
  });

  it('fetches a damaged part once more where there are ranges', async () => {
    const { page, asked, damage } = await loaded({ data: flipped(1, 0) }, 'complete');
    assert.equal(damage, '');
    assert.ok(asked.some(({ range }) => range));
    assert.deepEqual(await pictureOf(page), whole);
    await page.context().close();
  });

  it('goes on where the connection was gone for a while', async () => {
    const { page, asked, damage } = await loaded({ outage: 4 }, 'complete', 'damaged');
    assert.equal(damage, '');
    assert.ok(asked.filter(({ range }) => range).length >= 4);
    assert.deepEqual(await pictureOf(page), whole);
    await page.context().close();
  });

  it('says so where a server lets a page start no workers', async () => {
    const { page, damage } = await loaded({ policy: "worker-src 'none'" }, 'failed', 'complete');
    assert.match(damage, /cannot be shown: .*workers/);
    await page.context().close();
  });

  it('says which part is damaged, and shows the rest', async () => {
    const { page, damage } = await loaded({ data: flipped(1, 0), ranges: false }, 'damaged');
    assert.match(damage, /The data are damaged.*coarse, pixels 0 to 31 across, 0 to 31 down: it does not fit its checksum/);
    const found = await pictureOf(page);
    const { width } = head.levels[1];
    const isOutside = (_, i) => (i / 4) % width >= 32 || i / 4 / width >= 32;
    assert.deepEqual(found.filter(isOutside), whole.filter(isOutside));
    assert.ok(found.every((byte, i) => i % 4 < 3 || byte === 255), 'the preview stands where the block is missing');
    await page.context().close();
  });

  it('shows what came of data that are cut short', async () => {
    const last = head.levels[1].layers.at(-1);
    const data = made.data.subarray(0, rest + last.offset + last.indexBytes + Math.floor(last.chunkBytes / 2));
    const { page, damage } = await loaded({ data, ranges: false }, 'damaged');
    assert.match(damage, /all that is missing of it: the data end after \d+ bytes/);
    assert.ok((await pictureOf(page)).every((byte, i) => i % 4 < 3 || byte === 255));
    await page.context().close();
  });

  it('refuses data that are none, a head that is damaged, and data that are not there', async () => {
    const noHead = Buffer.from(made.data);
    noHead[30] ^= 1;
    for (const [data, said] of [[Buffer.alloc(2000), /not those of such a page/], [noHead, /head of the data is damaged/], [null, /the server answers 404/]]) {
      const { page, damage } = await loaded({ data, ranges: false }, 'failed');
      assert.match(damage, said);
      await page.context().close();
    }
  });

  it('opens from a disk where it is one file', async () => {
    const page = await open(browser, pathToFileURL(made.at('room.html')).href);
    await state(page, 'complete');
    assert.deepEqual(page.complaints, []);
    await settled(page);
    assert.deepEqual(await pictureOf(page), whole);
    await page.context().close();
  });
});
