"use strict";

// Figures are drawn one behind the other, so that the page answers meanwhile.
(async () => {
  const figures = JSON.parse(document.getElementById("figure-data").textContent);
  const buttons = [["toImage", "zoom2d", "pan2d", "resetScale2d"]]; // none that sends anything
  const settings = { responsive: true, displaylogo: false, modeBarButtons: buttons };
  for (const [number, figure] of figures.entries()) {
    await Plotly.newPlot(`figure-${number}`, figure.data, figure.layout, settings);
    await new Promise((next) => setTimeout(next));
  }
  document.documentElement.dataset.figures = String(figures.length);
})();
