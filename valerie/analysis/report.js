// Draw every figure over its static picture; a figure that fails keeps the picture.
"use strict";
(() => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const config = {
    displaylogo: false,
    responsive: true,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d", "toImage"],
  };
  for (const place of document.querySelectorAll("[data-figure]")) {
    const figure = figures[Number(place.dataset.figure)];
    const live = place.querySelector(".live");
    place.classList.add("drawn");
    Plotly.newPlot(live, figure.data, figure.layout, config).catch(() => place.classList.remove("drawn"));
  }
})();
