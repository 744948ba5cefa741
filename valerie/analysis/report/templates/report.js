// Draw every figure over its static picture; a figure that fails keeps the picture.
"use strict";
(() => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const config = {
    displayModeBar: false, // drag to zoom, double click to go back
    responsive: true,
  };
  for (const place of document.querySelectorAll("[data-figure]")) {
    const figure = figures[Number(place.dataset.figure)];
    const live = place.querySelector(".live");
    place.classList.add("drawn");
    Plotly.newPlot(live, figure.data, figure.layout, config).catch(() => place.classList.remove("drawn"));
  }
})();
