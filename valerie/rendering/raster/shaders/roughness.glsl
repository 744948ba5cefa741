// Packs the factors of a roughness texture into 16 bits: roughness (low byte) and metallic.
const uint NO_ROUGHNESS_TEXTURE = 0xffffu;

uint packed_factors(vec2 factors) {
    uvec2 bytes = uvec2(clamp(factors, 0.0, 1.0) * 255.0 + 0.5);
    return bytes.x | bytes.y << 8u;
}

vec2 unpacked_factors(uint bits) {
    return vec2(bits & 0xffu, bits >> 8u) / 255.0;
}
