// Looking around in a panorama: what is seen where, by analytic directions, and on the page by every way to compute.

import assert from 'node:assert/strict';
import { readFileSync, writeFileSync } from 'node:fs';
import { describe, it, before, after } from 'node:test';
import { deflateRawSync, inflateRawSync } from 'node:zlib';
import { fileURLToPath } from 'node:url';
import { LookAround, drawAround } from '../src/around.js';
import { crc32 } from '../src/checksum.js';
import { difference, hasBrowser, launch, ltm, open, pictureOf, pngBytes, room, serve, set, settled, state } from './helpers.mjs';

const HERE = fileURLToPath(new URL('.', import.meta.url));
const SHOTS = process.env.LTM_SHARE_SHOTS;
const DEGREE = Math.PI / 180;

/** Looking to yaw and pitch by so many degrees. */
function looking(yaw, pitch, field = 80) {
  const look = new LookAround();
  look.goTo([yaw, pitch, field]);
  return look;
}

/** The direction of a panorama's place as the scene's camera has it: to the right, up, ahead. */
function directionOf(u, v) {
  const [turn, down] = [2 * Math.PI * u, Math.PI * v];
  return [-Math.sin(turn) * Math.sin(down), Math.cos(down), -Math.cos(turn) * Math.sin(down)];
}

/** Where a view sees a direction, by turning it into the view; none behind. */
function seenAt({ yaw, pitch, field }, width, height, [right, up, ahead]) {
  const [x, z] = [right * Math.cos(yaw) - ahead * Math.sin(yaw), ahead * Math.cos(yaw) + right * Math.sin(yaw)];
  const [y, depth] = [up * Math.cos(pitch) - z * Math.sin(pitch), z * Math.cos(pitch) + up * Math.sin(pitch)];
  const scale = Math.max(width, height) / 2 / Math.tan(field / 2);
  return depth > 0 ? [width / 2 + (x / depth) * scale, height / 2 - (y / depth) * scale] : null;
}

const isNear = (found, expected, what) => assert.ok(found.every((v, i) => Math.abs(v - expected[i]) < 1e-9), `${what}: ${found} for ${expected}`);

describe('looking around', () => {
  it('sees what the camera saw there', () => {
    const middle = (look) => look.sight(300, 200)(150, 100);
    isNear(middle(looking(0, 0)), [0.5, 0.5], 'ahead');
    isNear(middle(looking(90, 0)), [0.75, 0.5], 'right');
    isNear(middle(looking(-90, 0)), [0.25, 0.5], 'left');
    isNear(middle(looking(0, 45)), [0.5, 0.25], 'half up');
    assert.ok(middle(looking(0, 90))[1] < 1e-9 && middle(looking(0, -90))[1] > 1 - 1e-9, 'the poles');
    assert.ok([0, 1].includes(Math.round(1e9 * middle(looking(180, 0))[0]) / 1e9), 'the seam');
    // A field of view of 90° ends 45° aside, along the larger side.
    isNear(looking(0, 0, 90).sight(300, 200)(300, 100), [0.625, 0.5], 'the right edge');
    isNear(looking(0, 0, 90).sight(200, 300)(100, 0), [0.5, 0.25], 'the upper edge');
    isNear(looking(170, 0, 90).sight(300, 200)(300, 100), [(170 + 45 - 180) / 360, 0.5], 'beyond the seam');
    // Straight up, what lies ahead of the camera is below.
    isNear(looking(0, 90, 90).sight(200, 200)(100, 200), [0.5, 0.25], 'below straight up');
    // Half a turn from what lay ahead to what lay behind, over the pole.
    assert.ok([0, 1].includes(looking(0, 90, 90).sight(200, 200)(100, 0)[0]), 'above straight up');
  });

  it('is the inverse of projecting a direction', () => {
    let seen = 0;
    for (const [yaw, pitch, field] of [[0, 0, 80], [123, 40, 30], [-179, -70, 100], [180, 90, 60], [77, -90, 95]]) {
      const look = looking(yaw, pitch, field);
      const sight = look.sight(317, 211);
      for (let i = 0; i < 36; i++) {
        for (let j = 0; j < 18; j++) {
          const [u, v] = [(i + 0.5) / 36, (j + 0.5) / 18];
          const at = seenAt(look, 317, 211, directionOf(u, v));
          if (!at) continue;
          seen++;
          isNear(sight(...at), [u, v], `${yaw}, ${pitch}`);
        }
      }
    }
    assert.ok(seen > 1000);
  });

  it('has its bounds', () => {
    const look = new LookAround();
    look.turn(350 * DEGREE, 400 * DEGREE);
    isNear([look.yaw, look.pitch], [-10 * DEGREE, 90 * DEGREE], 'turned');
    look.turn(0, -400 * DEGREE);
    isNear([look.pitch], [-90 * DEGREE], 'down');
    look.zoom(100);
    assert.equal(Math.round(look.field / DEGREE), 30);
    look.zoom(0.01);
    assert.equal(Math.round(look.field / DEGREE), 100);
    look.goTo([1, 2, Number.NaN]);
    assert.equal(Math.round(look.field / DEGREE), 100, 'nonsense changes nothing');
    const panorama = { width: 360, height: 180 };
    assert.deepEqual(looking(180, 0).pixelAt(panorama, 100, 100, 50, 50), { x: 0, y: 90 });
    assert.deepEqual(looking(-0.5, 89.5).pixelAt(panorama, 100, 100, 50, 50), { x: 179, y: 0 });
    assert.equal(looking(0, -90).pixelAt(panorama, 100, 100, 50, 50).y, 179);
  });

  it('draws every pixel where it is seen, over seam and poles', () => {
    const [width, height] = [256, 128];
    const panorama = { width, height, data: new Uint8ClampedArray(4 * width * height).fill(255) };
    // Smooth on the sphere: each channel is a component of the direction.
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        directionOf((x + 0.5) / width, (y + 0.5) / height).forEach((v, ch) => (panorama.data[4 * (y * width + x) + ch] = 127.5 + 120 * v));
      }
    }
    for (const [yaw, pitch, field] of [[0, 0, 80], [180, 0, 30], [178, 10, 100], [30, 90, 90], [0, -80, 40], [-100, 62, 70]]) {
      const look = looking(yaw, pitch, field);
      const view = { width: 203, height: 131, data: new Uint8ClampedArray(4 * 203 * 131) };
      drawAround(panorama, look, view, 0, 203);
      const sight = look.sight(203, 131);
      let most = 0;
      for (let y = 0; y < 131; y++) {
        for (let x = 0; x < 203; x++) {
          const exact = directionOf(...sight(x + 0.5, y + 0.5)).map((v) => 127.5 + 120 * v);
          exact.forEach((v, ch) => (most = Math.max(most, Math.abs(v - view.data[4 * (y * 203 + x) + ch]))));
        }
      }
      // Bytes of the panorama and of the view round; between pixels of 1.4°, a straight line is 120 · 0.025² / 8 off, and in the last half
      // row at a pole a pixel is as far from the pole as 120 · 0.0123.
      assert.ok(most < 2.6, `${yaw}, ${pitch}, ${field}: ${most}`);
      assert.ok(view.data.every((byte, i) => i % 4 < 3 || byte === 255));
    }
  });
});

describe('a panorama on the page', { skip: !hasBrowser }, () => {
  let [browser, server, made, files] = [];
  const SIZE = [256, 128];

  before(async () => {
    made = room();
    for (const name of ['room.obj', 'room.mtl']) writeFileSync(made.at(name), readFileSync(`${HERE}room/${name}`));
    const camera = '[camera]\neye = [0.1, 0.9, 0.2]\ndirection = [0.0, 0.0, -1.0]\nprojection = "panorama"\nwidth = 256\nheight = 128\n';
    const scene = readFileSync(`${HERE}room/room.toml`, 'utf8').replace(/\[camera\]\n(.+\n)+/, camera);
    writeFileSync(made.at('around.toml'), scene);
    ltm('render', made.at('around.toml'), '--pack', '-o', made.at('around.ltc'));
    ltm('share', made.at('around.ltc'), '-o', made.at('around'), '--lighting', made.looks);
    files = { page: readFileSync(made.at('around/index.html')), data: readFileSync(made.at('around/picture.lts')) };
    [browser, server] = [await launch(), await serve(files)];
  });

  after(async () => {
    await browser?.close();
    server?.close();
  });

  const loaded = async ({ way = 'webgl2', fragment = '', url = server.url, ...options } = {}) => {
    const page = await open(browser, `${url}?compute=${way}${fragment}`, options);
    await state(page, 'complete');
    await settled(page);
    return page;
  };
  /** Once what was turned is drawn. */
  const drawn = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  const aroundOf = async (page) => {
    await drawn(page);
    const { width, height, text } = await page.evaluate(() => {
      const canvas = document.getElementById('around');
      const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
      let text = '';
      for (let at = 0; at < data.length; at += 8192) text += String.fromCharCode(...data.subarray(at, at + 8192));
      return { width: canvas.width, height: canvas.height, text };
    });
    return { width, height, data: Buffer.from(text, 'latin1') };
  };
  /** What is to be seen of the picture on the page. */
  const expected = (picture, look, { width, height }) => {
    const view = { width, height, data: new Uint8ClampedArray(4 * width * height) };
    drawAround({ width: SIZE[0], height: SIZE[1], data: new Uint8ClampedArray(picture) }, look, view, 0, width);
    return view.data;
  };
  const shot = (page, name) => (SHOTS ? page.screenshot({ path: `${SHOTS}/${name}.png` }) : null);
  const sees = async (page, look, what) => {
    const view = await aroundOf(page);
    const apart = difference(view.data, expected(await pictureOf(page), look, view));
    assert.ok(apart.lengths[0] === apart.lengths[1] && apart.largest <= 1, `${what}: ${JSON.stringify(apart)}`);
    return view;
  };
  const probed = async (page, { x, y }) => {
    await page.waitForFunction((begin) => document.getElementById('probe').textContent.startsWith(begin), `${x}, ${y} `, { timeout: 5000 });
  };
  const middle = async (page) => {
    const box = await page.locator('#stage').boundingBox();
    return [box.x + box.width / 2, box.y + box.height / 2, box];
  };

  for (const way of ['worker', 'webgl2', 'webgpu']) {
    it(`is looked around in by ${way}`, async (test) => {
      const page = await loaded({ way });
      const taken = await page.evaluate(() => document.body.dataset.way);
      if (taken !== way) return test.skip(`this browser has no ${way}: it took ${taken}`);
      // The picture below is the relighter's, as ever.
      const exposure = await page.evaluate(() => document.getElementById('exposure').value);
      await set(page, '#exposure', exposure);
      await settled(page);
      ltm('relight', made.at('around.ltc'), '-o', made.at('around.png'), '--device', 'cpu', '--exposure', exposure);
      const rgb = (bytes) => bytes.filter((_, i) => i % 4 < 3);
      const apart = difference(rgb(await pictureOf(page)), rgb(await pngBytes(browser, made.at('around.png'))));
      assert.ok(apart.largest <= 8 && apart.far <= 0.01, JSON.stringify(apart));
      const look = looking(0, 0);
      await sees(page, look, 'at first');
      await shot(page, `around-${way}`);
      await page.locator('#stage').focus();
      for (let i = 0; i < 27; i++) await page.keyboard.press('ArrowRight');
      look.turn(27 * look.field / 12, 0);
      const { width, height } = await sees(page, look, 'behind');
      assert.equal(Math.abs(Math.round(look.yaw / DEGREE)), 180);
      await shot(page, `around-${way}-behind`);
      // A mix is seen in it too.
      await page.getByRole('button', { name: 'Evening' }).click();
      await settled(page);
      await sees(page, look, 'a look');
      assert.ok(width > 100 && height > 100);
      assert.deepEqual(page.complaints, []);
      await page.context().close();
    });
  }

  it('is turned, zoomed and read by mouse and keys', async () => {
    const page = await loaded();
    const look = looking(0, 0);
    const [x, y, box] = await middle(page);
    const pixel = (atX, atY) => look.pixelAt({ width: SIZE[0], height: SIZE[1] }, box.width, box.height, atX - box.x, atY - box.y);
    await page.mouse.move(x + 200, y - 100);
    await probed(page, pixel(x + 200, y - 100));
    // What was taken hold of in the middle goes with the pointer.
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x - 150, y + 60, { steps: 5 });
    await page.mouse.up();
    const focal = look.focal(box.width, box.height);
    look.turn(150 / focal, 60 / focal);
    await sees(page, look, 'dragged');
    await probed(page, pixel(x - 150, y + 60));
    await page.mouse.wheel(0, -300);
    await page.waitForTimeout(100);
    look.zoom(2);
    await sees(page, look, 'zoomed by the wheel');
    await probed(page, pixel(x - 150, y + 60));
    await page.locator('#stage').focus();
    // Up to the pole and no further; the cross in the middle reads there.
    for (let i = 0; i < 40; i++) await page.keyboard.press('ArrowUp');
    look.turn(0, 4);
    await sees(page, look, 'up');
    await shot(page, 'around-up');
    for (let i = 0; i < 3; i++) await page.keyboard.press('Shift+ArrowLeft');
    look.turn(-3 * look.field / 200, 0);
    await sees(page, look, 'a little to the left');
    for (const key of ['f', '-', '-', 'ArrowRight']) await page.keyboard.press(key);
    look.ahead();
    [1, 2].forEach(() => look.zoom(Math.SQRT1_2));
    look.turn(look.field / 12, 0);
    await sees(page, look, 'ahead again, wide');
    await probed(page, pixel(x, y));
    await page.keyboard.press('1');
    // One pixel of the panorama for one of the screen is less than it zooms out to: these are few.
    assert.ok(look.field > 99 * DEGREE);
    assert.deepEqual(page.complaints, []);
    await page.context().close();
  });

  it('is seen flat by button and key, and says which it is', async () => {
    const page = await loaded();
    const button = page.getByRole('button', { name: 'Look around', exact: true });
    const label = () => page.locator('#stage').getAttribute('aria-label');
    assert.equal(await button.getAttribute('aria-pressed'), 'true');
    assert.match(await label(), /^Panorama: arrow keys turn/);
    await button.click();
    assert.equal(await button.getAttribute('aria-pressed'), 'false');
    assert.match(await label(), /^Picture: arrow keys move it.*P looks around/);
    assert.ok(await page.locator('#picture').isVisible() && !(await page.locator('#around').isVisible()));
    const box = await page.locator('#picture').boundingBox();
    await page.mouse.move(box.x + (30.5 / 256) * box.width, box.y + (100.5 / 128) * box.height);
    await probed(page, { x: 30, y: 100 });
    await shot(page, 'around-flat');
    await page.keyboard.press('p');
    assert.equal(await button.getAttribute('aria-pressed'), 'true');
    await sees(page, looking(0, 0), 'again');
    await page.context().close();
    const plain = await serve(made);
    const other = await open(browser, `${plain.url}?compute=webgl2`);
    await state(other, 'complete');
    assert.ok(!(await other.locator('#look').isVisible()), 'a picture of another camera is no panorama');
    await other.keyboard.press('p');
    assert.ok(await other.locator('#picture').isVisible());
    await other.context().close();
    plain.close();
  });

  it('is compared beside a wipe that stands in the view, and kept in a link', async () => {
    const page = await loaded();
    await page.locator('#stage').focus();
    for (const key of ['ArrowLeft', 'ArrowLeft', 'ArrowDown', '+']) await page.keyboard.press(key);
    const look = looking(0, 0);
    look.turn(-2 * look.field / 12, -look.field / 12);
    look.zoom(Math.SQRT2);
    const plain = await sees(page, look, 'turned');
    const picture = await pictureOf(page);
    await page.waitForTimeout(600);
    const fragment = await page.evaluate(() => location.hash);
    await page.getByLabel('Compare with').selectOption({ label: 'Evening' });
    await settled(page);
    // The room for the picture is another beside the wipe's slider.
    const both = await aroundOf(page);
    const now = expected(picture, look, both);
    const half = Math.round(both.width / 2);
    const sides = [(i) => (i / 4) % both.width < half, (i) => (i / 4) % both.width >= half];
    const [left, right] = sides.map((isIn) => difference(both.data.filter((_, i) => isIn(i)), now.filter((_, i) => isIn(i))));
    assert.ok(left.mean > 2 && right.largest <= 1, JSON.stringify([left, right]));
    await shot(page, 'around-wipe');
    const [line, stage] = [await page.locator('#line').boundingBox(), await page.locator('#stage').boundingBox()];
    assert.ok(Math.abs(line.x + 1 - stage.x - stage.width / 2) < 1.5);
    await page.mouse.move(line.x + 1, line.y + 100);
    await page.mouse.down();
    await page.mouse.move(line.x + 1 + 0.2 * stage.width, line.y + 100);
    await page.mouse.up();
    assert.ok(Math.abs(Number(await page.locator('#wipe').inputValue()) - 0.7) < 0.02);
    await page.context().close();
    const again = await loaded({ fragment });
    const kept = await aroundOf(again);
    // A link has degrees to a tenth.
    assert.ok(difference(kept.data, plain.data).mean < 1.5);
    await again.context().close();
  });

  it('is turned and pinched by fingers', async () => {
    const page = await loaded({ viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2 });
    const [x, y, box] = await middle(page);
    const session = await page.context().newCDPSession(page);
    const touch = (type, ...points) => session.send('Input.dispatchTouchEvent', { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
    const look = looking(0, 0);
    await touch('touchStart', [x, y]);
    await touch('touchMove', [x + 20, y]);
    await touch('touchMove', [x + 60, y]);
    await touch('touchEnd');
    look.turn(-60 / look.focal(box.width, box.height), 0);
    await page.waitForTimeout(300);
    await sees(page, look, 'turned by a finger');
    await touch('touchStart', [x - 40, y], [x + 40, y]);
    await touch('touchMove', [x - 40, y], [x + 80, y]);
    await touch('touchEnd');
    look.zoom(1.5);
    await page.waitForTimeout(300);
    await sees(page, look, 'pinched');
    await shot(page, 'around-phone');
    await page.context().close();
  });

  it('is offered, not begun with, where only the shape of the picture speaks for it', async () => {
    const { data } = files;
    const end = 20 + data.readUInt32LE(12);
    const json = JSON.parse(inflateRawSync(data.subarray(20, end)).toString());
    assert.equal(json.panorama, true);
    const head = deflateRawSync(JSON.stringify({ ...json, panorama: null }));
    const start = Buffer.from(data.subarray(0, 20));
    start.writeUInt32LE(head.length, 12);
    start.writeUInt32LE(crc32(head), 16);
    const own = await serve({ page: files.page, data: Buffer.concat([start, head, data.subarray(end)]) });
    const page = await loaded({ url: own.url });
    const button = page.getByRole('button', { name: 'Look around', exact: true });
    assert.equal(await button.getAttribute('aria-pressed'), 'false');
    assert.ok(await page.locator('#picture').isVisible());
    await button.click();
    await sees(page, looking(0, 0), 'by the button');
    await page.context().close();
    own.close();
  });
});
