// Real spherical harmonics as prtnet/sh.py has them: index l*l + l + m, no Condon-Shortley phase, on world x, y, z.

// Y_i of a unit direction, for `bands` bands.
export function harmonics([x, y, z], bands) {
  const out = new Float64Array(bands * bands);
  let cosine = 1;
  let sine = 0;
  let diagonal = Math.sqrt(1 / (4 * Math.PI));
  for (let m = 0; m < bands; ++m) {
    if (m > 0) {
      [cosine, sine] = [x * cosine - y * sine, x * sine + y * cosine];
      diagonal *= Math.sqrt((2 * m + 1) / (2 * m));
    }
    let before = 0;
    let legendre = diagonal * (m > 0 ? Math.SQRT2 : 1);
    for (let l = m; l < bands; ++l) {
      if (l > m) {
        const ahead = Math.sqrt((4 * l * l - 1) / (l * l - m * m));
        const behind = Math.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1));
        [before, legendre] = [legendre, ahead * (z * legendre - behind * before)];
      }
      out[l * l + l + m] = legendre * cosine;
      if (m > 0) out[l * l + l - m] = legendre * sine;
    }
  }
  return out;
}

// Coefficients [[r, g, b], ...] of a light turned about +y, from +z towards +x. `upright` is the matrix, row by row, that
// turns +y into +z: there a turn about the axis is a turn of each pair m, -m, and back again is its transpose.
export function turned(coefficients, degrees, upright) {
  const count = coefficients.length;
  const angle = (degrees * Math.PI) / 180;
  const standing = product(upright, coefficients, false);
  const spun = standing.map((row) => [...row]);
  for (let l = 0; l * l < count; ++l)
    for (let m = 1; m <= l; ++m) {
      const [plus, minus] = [l * l + l + m, l * l + l - m];
      const [c, s] = [Math.cos(m * angle), Math.sin(m * angle)];
      for (let rgb = 0; rgb < 3; ++rgb) {
        spun[plus][rgb] = c * standing[plus][rgb] - s * standing[minus][rgb];
        spun[minus][rgb] = s * standing[plus][rgb] + c * standing[minus][rgb];
      }
    }
  return product(upright, spun, true);
}

function product(matrix, vectors, transposed) {
  const count = vectors.length;
  return vectors.map((_, i) => {
    const sum = [0, 0, 0];
    for (let j = 0; j < count; ++j) {
      const factor = transposed ? matrix[j * count + i] : matrix[i * count + j];
      if (factor) for (let rgb = 0; rgb < 3; ++rgb) sum[rgb] += factor * vectors[j][rgb];
    }
    return sum;
  });
}

// Zonal coefficients A_l of the clamped cosine (Ramamoorthi and Hanrahan 2001): irradiance is sum A_l L_i Y_i(n).
export function cosineZonal(bands) {
  const out = [];
  let choose = 1; // (l choose l/2) / 2^l
  for (let l = 0; l < bands; ++l) {
    if (l % 2 === 0 && l > 0) choose *= (l - 1) / l;
    if (l === 1) out.push((2 * Math.PI) / 3);
    else if (l % 2) out.push(0);
    else out.push((2 * Math.PI * (-1) ** (l / 2 + 1) * choose) / ((l + 2) * (l - 1)));
  }
  return out;
}
