// Draws the runs of a report as curves that can be zoomed. Without JavaScript, and in print, its
// picture of the motion stands in their place.
(() => {
  const place = document.getElementById("curves");
  place.parentElement.hidden = false; // before it is measured
  document.documentElement.classList.add("live");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const grid = {stroke: "rgba(128,128,128,.25)", width: 1};
  const decoded = (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return Array.from(new Float32Array(bytes.buffer), (v) => (Number.isFinite(v) ? v : null));
  };
  const sum = (a, b) => a.map((v, i) => (v === null || b[i] === null ? null : v + b[i]));
  const runs = JSON.parse(document.getElementById("curves-data").textContent);
  let drawn = [];
  const wide = () => Math.min(place.parentElement.clientWidth, 736);
  const shade = (one) => (dark.matches ? one.dark : one.colour);
  const draw = (run, title, height, time, series, columns, ink) => {
    const axis = {stroke: ink, grid, ticks: grid, font: "12px sans-serif", labelFont: "12px sans-serif"};
    drawn.push(new uPlot({
      width: wide(), height,
      scales: {x: {time: false}},
      axes: [{...axis, label: "time [s]"}, {...axis, label: title, size: 70}],
      series: [{label: "time [s]"}, ...series],
      cursor: {sync: {key: run.name}, drag: {x: true, y: false}},
      legend: {markers: {fill: (_, i) => (i && series[i - 1].width > 2 ? series[i - 1].stroke : null)}},
      hooks: {drawClear: run.ground ? [(u) => {
        u.ctx.fillStyle = shade(run.ground);
        u.ctx.fillRect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      }] : []},
    }, [time, ...columns], place));
  };
  const drawAll = () => {
    const ink = getComputedStyle(document.body).color;
    drawn.forEach((u) => u.destroy());
    drawn = [];
    place.replaceChildren();
    for (const run of runs) {
      const heading = place.appendChild(document.createElement("p"));
      heading.textContent = run.name;
      const measured = decoded(run.measured);
      const errors = run.runs.map((one) => decoded(one.error));
      const time = measured.map((_, i) => run.begins + i * run.period);
      const lines = run.runs.map((one) => ({
        label: one.label, stroke: shade(one), width: 1.5, dash: one.dashes,
      }));
      const said = lines.map((line, i) => ({...line, label: `${line.label}, ${run.runs[i].rms}`}));
      draw(run, `${run.quantity} [${run.unit}]`, 260, time,
        [{label: "measured", stroke: shade(run.under), width: run.under.width, points: {show: false}}, ...said],
        [measured, ...errors.map((e) => sum(measured, e))], ink);
      draw(run, `error [${run.unit}]`, 210, time, lines, errors, ink);
    }
  };
  drawAll();
  dark.addEventListener("change", drawAll); // colours for the other ground
  addEventListener("resize", () => drawn.forEach((u) => u.setSize({width: wide(), height: u.height})));
})();
