"use strict";
// Draws the page's figures when they come into view, in the colours of the reader's choice of light or dark.
(() => {
  const DARK = {
    "#222222": "#e6e8ea", "#555555": "#a7adb5", "#e2e2e2": "#343941", "#ececec": "#2b2f37", "#f3d9b1": "#54401f",
    "#0072b2": "#56b4e9", "#d55e00": "#ff8f45", "#000000": "#f0f0f0", "#808080": "#9b9b9b", "#f4f4f4": "#2b2f37",
    "#a6d5f5": "#27567a", "#fdf1e3": "#33261b", "#fde0c0": "#5b3512", "#e8873a": "#d27427", "#8c3a00": "#ffd0a1", "#ffffff": "#14161a", "#009e73": "#3ecfa4"
  };
  const SHEET = 900; // pixels of A4 or Letter at the width of a page that is printed, with room for a title
  // Height of a figure on paper over that on the screen; the first place that holds the figure decides.
  const ON_PAPER = [["#torque .grid", 0.9], ["#torque", 0.74], ["#fails details", 0.68], ["#fails", 0.62],
    ["#missing", 0.68], ["#parameters .grid", 0.75], ["#data", 0.8], ["body", 1]];
  const wanted = window.matchMedia("(prefers-color-scheme: dark)");
  const plots = [...document.querySelectorAll(".plot")];
  const data = new Map(plots.map((p) => [p, p.querySelector("script").textContent]));
  const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] };
  let printing = false;

  // Another model whose curves are dotted: an earlier step of this one, or a second model. One for all joints.
  const shown = document.getElementById("overlay-shown"), which = document.getElementById("overlay");
  const overlaid = () => (shown && shown.checked ? Number(which ? which.value : 0) : -1);
  function overlay() {
    const names = JSON.parse(document.getElementById("overlay-names").textContent);
    const name = names[which ? Number(which.value) : 0];
    document.getElementById("overlay-name").textContent = name;
    if (which) { which.setAttribute("aria-valuetext", name); which.disabled = !shown.checked; }
    plots.filter((p) => p.dataset.drawn).forEach((p) => {
      const traces = p.data.flatMap((t, k) => (t.meta && "overlay" in t.meta ? [k] : []));
      if (traces.length) Plotly.restyle(p, { visible: traces.map((k) => p.data[k].meta.overlay === overlaid()) }, traces);
    });
  }
  if (shown) [shown, which].forEach((control) => control && control.addEventListener("input", overlay));

  const numbers = (array) => new Float32Array(Uint8Array.from(atob(array.bdata), (c) => c.charCodeAt(0)).buffer);
  // Measured less the torque of another model, where this model's residual is known.
  function residual(traces, k) {
    const of = (name) => numbers(traces.find((t) => t.name === name).y);
    const model = numbers(traces.find((t) => t.meta && t.meta.overlay === k && t.y).y), own = of("residual");
    return Array.from(of("measured"), (x, i) => (Number.isNaN(own[i]) ? null : x - model[i]));
  }

  function draw(plot) {
    const dark = wanted.matches && !printing;
    const text = dark ? data.get(plot).replace(/#[0-9a-f]{6}/g, (c) => DARK[c] || c) : data.get(plot);
    const spec = JSON.parse(text);
    delete spec.layout.width;
    spec.data.forEach((trace) => {
      if (typeof trace.x === "number") trace.x = { ...spec.data[trace.x].x };
      if (trace.meta && "overlay" in trace.meta) trace.visible = trace.meta.overlay === overlaid();
      if (!("y" in trace)) trace.y = residual(spec.data, trace.meta.overlay);
    });
    const names = spec.data[0] && spec.data[0].type === "heatmap" && spec.layout.xaxis.tickangle !== -90 && spec.data[0].x;
    if (Array.isArray(names)) {
      // Joints' names stand upright only where they have to.
      spec.layout.xaxis.tickangle = 7.5 * names.join("").length > plot.clientWidth - 160 ? -60 : 0;
      if (!spec.layout.xaxis.tickangle) spec.layout.margin.b = 34;
    }
    const steps = spec.layout.xaxis.tickangle === -50 && spec.layout.xaxis.ticktext;
    if (steps && 8 * Math.max(...steps.join(" ").split(" ").map((w) => w.length)) * steps.length < plot.clientWidth - 90) {
      // So do the steps of a long staircase, and their errors.
      spec.layout.xaxis.tickangle = 0;
      spec.layout.xaxis.ticktext = steps.map((s) => s.replaceAll(" ", "<br>"));
      spec.layout.annotations.forEach((a) => { a.textangle = 0; });
      spec.layout.yaxis.range[1] *= 0.8;
      spec.layout.height -= 60;
    }
    if (plot.clientWidth < 480) {
      // A small screen: smaller letters, room for a legend of several lines, and no toolbar over the curves.
      spec.layout.font = { size: 11 };
      const named = spec.data.filter((trace) => trace.name && trace.showlegend !== false);
      if (named.length > 3 && spec.layout.showlegend !== false) spec.layout.height += 44;
      config.displayModeBar = false;
    }
    if (printing) {
      // Two joints' curves or eight residuals fit on one sheet, and so does a figure somewhat higher than one.
      const [, share] = ON_PAPER.find(([place]) => plot.closest(place));
      const high = spec.layout.height * share;
      const fits = high > SHEET && high < 1.6 * SHEET ? SHEET / high : 1;
      spec.layout.height = high * fits;
      spec.layout.font = { size: 10 };
      spec.data.forEach((trace) => { if (trace.line) trace.line.width *= fits; });
    }
    plot.style.height = spec.layout.height + "px";
    plot.querySelectorAll("script").forEach((s) => s.remove());
    Plotly.purge(plot); // one that is drawn again would keep its width, on paper too
    const frames = spec.frames || []; // of an animation: the poses of the robot
    Plotly.newPlot(plot, spec.data, spec.layout, config).then(() => frames.length && Plotly.addFrames(plot, frames));
    // The figure's title and reading are text beside it; its own letters would be read one by one.
    plot.querySelectorAll("svg.main-svg").forEach((svg) => svg.setAttribute("aria-hidden", "true"));
    plot.dataset.drawn = dark ? "dark" : "light";
  }

  const seen = new IntersectionObserver((entries) => {
    for (const e of entries) {
      if (e.isIntersecting) { seen.unobserve(e.target); draw(e.target); }
    }
  }, { rootMargin: "600px" });
  plots.forEach((p) => seen.observe(p));

  // A table as CSV, and the model: the browser makes the file, nothing leaves the page.
  function download(name, kind, text) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: kind }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
  // A spreadsheet would run a name such as =HYPERLINK(...) as a formula; with an apostrophe before it, the name is text.
  const formula = /^(?:[=@]|[-+].*[a-z(|!])/is;
  const quoted = (cell) => {
    const text = cell.textContent.trim().replace(/\u2212/g, "-").replaceAll('"', '""');
    return `"${formula.test(text) ? "'" : ""}${text}"`;
  };
  document.querySelectorAll(".scroll").forEach((box, k) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "csv";
    button.textContent = "CSV";
    button.setAttribute("aria-label", `Download as CSV: ${box.getAttribute("aria-label")}`);
    button.addEventListener("click", () => {
      const rows = [...box.querySelectorAll("tr")].map((r) => [...r.cells].map(quoted).join(","));
      download(`table-${k + 1}.csv`, "text/csv", "\ufeff" + rows.join("\r\n") + "\r\n");
    });
    box.after(button);
  });
  const model = document.getElementById("model"); // the page of the paper has none
  if (model) {
    document.getElementById("download-model").addEventListener("click", () => {
      download(model.dataset.name, "application/json", model.textContent);
    });
  }

  wanted.addEventListener("change", () => plots.filter((p) => p.dataset.drawn).forEach(draw));
  window.addEventListener("beforeprint", () => {
    printing = true;
    document.querySelectorAll("details").forEach((d) => { d.dataset.was = d.open ? "1" : ""; d.open = true; });
    document.body.classList.add("printing");
    plots.forEach(draw);
  });
  window.addEventListener("afterprint", () => {
    printing = false;
    document.body.classList.remove("printing");
    document.querySelectorAll("details").forEach((d) => { d.open = d.dataset.was === "1"; });
    plots.filter((p) => p.dataset.drawn).forEach(draw);
  });
})();
