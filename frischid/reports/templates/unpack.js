"use strict";
// plotly.js is in the page in the format of zlib (RFC 1951), a third of its size; this puts it back before anything is drawn.
(() => {
  const LENGTHS = [3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17, 19, 23, 27, 31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163, 195, 227, 258];
  const DISTANCES = [1, 2, 3, 4, 5, 7, 9, 13, 17, 25, 33, 49, 65, 97, 129, 193, 257, 385, 513, 769, 1025, 1537, 2049, 3073, 4097, 6145,
    8193, 12289, 16385, 24577];
  const ORDER = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
  const packed = document.getElementById("plotly");
  const bytes = Uint8Array.from(atob(packed.textContent), (c) => c.charCodeAt(0));
  const out = new Uint8Array(Number(packed.dataset.size));
  let read = 0, hold = 0, held = 0, written = 0;

  function need(n) {
    while (held < n) { hold |= bytes[read++] << held; held += 8; }
  }
  function bits(n) {
    need(n);
    const value = hold & ((1 << n) - 1);
    hold >>>= n; held -= n;
    return value;
  }
  // Of every sequence of bits, as they come: the symbol and the length of its code.
  function table(lengths) {
    const most = Math.max(...lengths), counts = new Uint16Array(17), next = new Uint16Array(17), found = new Uint16Array(1 << most);
    lengths.forEach((n) => { if (n) counts[n] += 1; });
    for (let n = 1, code = 0; n <= most; n += 1) next[n] = code = (code + counts[n - 1]) << 1;
    lengths.forEach((n, symbol) => {
      if (!n) return;
      const code = next[n]++;
      let first = 0;
      for (let k = 0; k < n; k += 1) first |= ((code >> k) & 1) << (n - 1 - k);
      for (let k = first; k < found.length; k += 1 << n) found[k] = (symbol << 4) | n;
    });
    return [found, most];
  }
  function symbol([found, most]) {
    need(most);
    const entry = found[hold & ((1 << most) - 1)];
    hold >>>= entry & 15; held -= entry & 15;
    return entry >> 4;
  }
  function tables() {
    const literals = bits(5) + 257, distances = bits(5) + 1, count = bits(4) + 4, small = new Array(19).fill(0), lengths = [];
    for (let k = 0; k < count; k += 1) small[ORDER[k]] = bits(3);
    const code = table(small);
    while (lengths.length < literals + distances) {
      const s = symbol(code);
      if (s < 16) lengths.push(s);
      else {
        const value = s === 16 ? lengths[lengths.length - 1] : 0, times = s === 16 ? 3 + bits(2) : s === 17 ? 3 + bits(3) : 11 + bits(7);
        for (let k = 0; k < times; k += 1) lengths.push(value);
      }
    }
    return [table(lengths.slice(0, literals)), table(lengths.slice(literals))];
  }
  const fixed = () => [table(Array.from({ length: 288 }, (_, k) => (k < 144 ? 8 : k < 256 ? 9 : k < 280 ? 7 : 8))), table(new Array(30).fill(5))];

  for (let last = 0; !last;) {
    last = bits(1);
    const kind = bits(2);
    if (kind === 0) {
      read -= held >> 3; // bytes as they are begin at a whole byte
      hold = held = 0;
      const size = bytes[read] | (bytes[read + 1] << 8);
      out.set(bytes.subarray(read + 4, read + 4 + size), written);
      read += 4 + size; written += size;
      continue;
    }
    const [literal, distance] = kind === 1 ? fixed() : tables();
    for (let s = symbol(literal); s !== 256; s = symbol(literal)) {
      if (s < 256) { out[written++] = s; continue; }
      const size = LENGTHS[s - 257] + (s < 265 || s === 285 ? 0 : bits((s - 261) >> 2));
      const d = symbol(distance), back = DISTANCES[d] + (d < 4 ? 0 : bits((d - 2) >> 1));
      for (let k = 0; k < size; k += 1, written += 1) out[written] = out[written - back];
    }
  }
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(out);
  document.head.append(script);
  packed.remove();
})();
