{
  const packed = document.getElementById('packed').textContent;
  const bytes = Uint8Array.from(atob(packed), (sign) => sign.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate-raw'));
  new Response(stream).text().then((text) => {
    const script = document.createElement('script');
    script.id = 'script';
    script.textContent = text;
    document.body.append(script);
  });
}
