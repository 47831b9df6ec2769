// What the tests share: containers and pages made by the program, servers of several kinds, a browser.

import { execFileSync } from 'node:child_process';
import { createServer } from 'node:http';
import { mkdtempSync, readFileSync, existsSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before } from 'node:test';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';

const HERE = fileURLToPath(new URL('.', import.meta.url));
const LTM = process.env.LTM ?? join(HERE, '../../target/debug/ltm');
const CHROMIUM = process.env.CHROMIUM ?? '/usr/bin/chromium';

/** Runs the program. */
export function ltm(...options) {
  return execFileSync(LTM, options, { encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe'] });
}

/** A folder with a container of a small room, its page, and its page in one file; made once for each process. */
export const room = (() => {
  let made = null;
  return () => {
    if (made) return made;
    const folder = mkdtempSync(join(tmpdir(), 'ltm-share-'));
    process.on('exit', () => rmSync(folder, { recursive: true, force: true }));
    const at = (name) => join(folder, name);
    const looks = join(HERE, 'room/looks.toml');
    ltm('render', join(HERE, 'room/room.toml'), '--pack', '-o', at('room.ltc'));
    ltm('share', at('room.ltc'), '-o', at('site'), '--lighting', looks, '--title', 'Test room');
    ltm('share', at('room.ltc'), '-o', at('room.html'), '--single', '--lighting', looks);
    made = { folder, at, looks, data: readFileSync(at('site/picture.lts')), page: readFileSync(at('site/index.html')) };
    return made;
  };
})();

/**
 * A static server of the room's page on the loopback. `ranges`: whether it knows them; `data`: what it serves in place of the data;
 * `more`: further files by their paths; `bytesPerSec`: how fast; `outage`: how often the data break off or are not to be had at all; `policy`: its Content-Security-Policy.
 * `asked`: what was asked of it.
 */
export async function serve({ page, data, more = {}, ranges = true, bytesPerSec = 0, outage = 0, policy = '', whole = data }) {
  const asked = [];
  const server = createServer(async (request, response) => {
    const { pathname } = new URL(request.url, 'http://localhost');
    asked.push({ path: pathname, range: request.headers.range });
    const body = pathname === '/' || pathname === '/index.html' ? page : pathname === '/picture.lts' ? data : more[pathname];
    if (!body) return response.writeHead(404).end();
    if (body !== page && outage > 0) {
      const isFirst = asked.filter(({ path }) => path === pathname).length === 1;
      outage--;
      if (!isFirst) return request.socket.destroy();
      response.writeHead(200, { 'content-length': body.length });
      // Time for the half to arrive.
      return response.write(body.subarray(0, body.length / 2), () => setTimeout(() => request.socket.destroy(), 300));
    }
    const type = body === page ? 'text/html' : 'application/octet-stream';
    if (policy) response.setHeader('content-security-policy', policy);
    const range = ranges && /^bytes=(\d+)-(\d*)$/.exec(request.headers.range ?? '');
    if (range) {
      // A part is asked for once more because it was damaged on the way: now it comes as it is.
      const [first, last] = [Number(range[1]), range[2] === '' ? whole.length - 1 : Number(range[2])];
      const part = whole.subarray(first, last + 1);
      response.writeHead(206, { 'content-type': type, 'content-range': `bytes ${first}-${last}/${whole.length}`, 'content-length': part.length });
      return response.end(part);
    }
    response.writeHead(200, { 'content-type': type, 'content-length': body.length });
    if (bytesPerSec === 0 || body === page) return response.end(body);
    for (let at = 0; at < body.length && !response.destroyed; at += bytesPerSec / 20) {
      response.write(body.subarray(at, at + bytesPerSec / 20));
      await new Promise((resolve) => setTimeout(resolve, 50));
    }
    response.end();
  });
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  // A test that fails leaves its server open: that must not keep the process.
  server.unref();
  return { url: `http://127.0.0.1:${server.address().port}/`, asked, close: () => server.closeAllConnections() ?? server.close() };
}

/** Whether there is a browser to test with. */
export const hasBrowser = existsSync(CHROMIUM);

/** For the tests of a group: a browser, the room, and a server of its page, each there once the tests run. */
export function visit() {
  const visited = {};
  before(async () => {
    visited.made = room();
    [visited.browser, visited.server] = [await launch(), await serve(visited.made)];
  });
  after(async () => {
    await visited.browser?.close();
    visited.server?.close();
  });
  return visited;
}

/** Headless Chromium; GPUs are software. */
export function launch() {
  return chromium.launch({
    executablePath: CHROMIUM,
    args: [
      '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync',
      '--enable-unsafe-webgpu', '--use-webgpu-adapter=swiftshader', '--enable-features=Vulkan', '--use-vulkan=swiftshader',
      '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
    ],
  });
}

/** Opens a page and keeps what it complains about. */
export async function open(browser, url, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, ...options });
  const page = await context.newPage();
  page.complaints = [];
  page.on('console', (message) => {
    if (message.type() === 'error') page.complaints.push(message.text());
  });
  page.on('pageerror', (error) => page.complaints.push(`${error.name}: ${error.message} ${error.stack ?? ""}`));
  await page.goto(url, { waitUntil: 'commit' });
  return page;
}

/** Waits until the page is in one of these states. */
export function state(page, ...wanted) {
  return page.waitForFunction((states) => states.includes(document.body?.dataset.state), wanted, { timeout: 60_000, polling: 20 });
}

/** Waits until all has come and nothing is left to draw. */
export async function settled(page) {
  await state(page, 'complete', 'damaged');
  await page.waitForFunction(() => document.body.dataset.drawing === 'no', null, { timeout: 60_000, polling: 20 });
}

/** The bytes of the picture that is seen, without alpha. */
export async function pictureOf(page) {
  const text = await page.evaluate(() => {
    const canvas = document.getElementById('picture');
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    return Array.from(data, (byte) => String.fromCharCode(byte)).join('');
  });
  return Buffer.from(text, 'latin1');
}

/** The bytes of a PNG, as the browser decodes it. */
export async function pngBytes(browser, path) {
  const page = await browser.newPage();
  const text = await page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (sign) => sign.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes]), { colorSpaceConversion: 'none' });
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    return Array.from(context.getImageData(0, 0, image.width, image.height).data, (byte) => String.fromCharCode(byte)).join('');
  }, readFileSync(path).toString('base64'));
  await page.close();
  return Buffer.from(text, 'latin1');
}

/** The largest and the mean difference of two pictures, and the share of bytes that differ by more than one step. */
export function difference(a, b) {
  let [largest, sum, far] = [0, 0, 0];
  for (let i = 0; i < a.length; i++) {
    const apart = Math.abs(a[i] - b[i]);
    largest = Math.max(largest, apart);
    sum += apart;
    far += Number(apart > 1);
  }
  return { largest, mean: sum / a.length, far: far / a.length, lengths: [a.length, b.length] };
}

/** Sets a range or select as a hand does. */
export function set(page, selector, value) {
  return page.evaluate(([selector, value]) => {
    const input = document.querySelector(selector);
    input.value = value;
    input.dispatchEvent(new Event('input', { bubbles: true }));
    input.dispatchEvent(new Event('change', { bubbles: true }));
  }, [selector, String(value)]);
}
