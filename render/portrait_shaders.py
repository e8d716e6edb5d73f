"""The shaders of a portrait: its skin, and the generic mouth behind its lips.

The mouth is drawn, not photographed: a dark cavity, the tongue, two rows of teeth. All its
lengths are in the mask's unit (the distance of the outer eye corners, some 90 mm), x from the
middle of the mouth, y down from the line between the closed lips. The upper teeth stay with the
skull, the lower ones go down with the jaw.
"""

from __future__ import annotations

from typing import Final

SKIN_VERTEX: Final = """
#version 330
uniform vec2 size;      // of the framebuffer
uniform vec2 corner;    // its first pixel in the photo
uniform vec2 texels;    // of the texture, which has one more between any two pixels
in vec2 position;       // photo pixels, centres at integers
in vec2 origin;         // where the vertex was in the photo
out vec2 place;
void main() {
    gl_Position = vec4(2.0 * (position + 0.5 - corner) / size - 1.0, 0.0, 1.0);
    place = (2.0 * origin + 0.5) / texels;
}
"""

SKIN_FRAGMENT: Final = """
#version 330
uniform sampler2D picture;
in vec2 place;
out vec4 colour;
void main() {
    colour = texture(picture, place);
}
"""

MOUTH_VERTEX: Final = """
#version 330
uniform vec2 size;
uniform vec2 corner;
uniform mat3 to_mouth;  // photo pixels to the mouth's frame, skull at rest
in vec2 position;
in vec2 depth;          // units below the upper lip and above the lower one
out vec2 at;
out vec2 lips;
void main() {
    gl_Position = vec4(2.0 * (position + 0.5 - corner) / size - 1.0, 0.0, 1.0);
    at = (to_mouth * vec3(position, 1.0)).xy;
    lips = depth;
}
"""

MOUTH_FRAGMENT: Final = """
#version 330
uniform vec3 teeth;
uniform vec3 gum;
uniform vec3 tongue;
uniform vec3 cavity;
uniform float jaw;      // units that the lower teeth have come down
uniform float raised;   // of the tongue, 0 to 1
uniform float pixel;    // one, in units
in vec2 at;
in vec2 lips;
out vec4 colour;

// Half the arch, seen from the front: outer edge of each tooth, from the middle.
const float UPPER[7] = float[](0.0, 0.088, 0.158, 0.222, 0.272, 0.312, 0.340);
const float LOWER[7] = float[](0.0, 0.054, 0.112, 0.170, 0.222, 0.266, 0.300);

// What is lit less has more of its light from lips and gums: it is redder.
vec3 shaded(vec3 colour, float light) {
    return colour * pow(vec3(max(light, 0.0)), vec3(0.86, 1.08, 1.12));
}

// One row of teeth: how much of a tooth is here, and how lit it is. y counts from the biting
// edge into the gum.
vec3 row(float x, float y, bool upper, float soft) {
    float side = abs(x);
    float first = 0.0, last = 0.0;
    int tooth = -1;
    for (int i = 0; i < 6; ++i) {
        float a = upper ? UPPER[i] : LOWER[i];
        float b = upper ? UPPER[i + 1] : LOWER[i + 1];
        if (side >= a && side < b) { first = a; last = b; tooth = i; }
    }
    if (tooth < 0) return vec3(0.0);
    float across = (2.0 * side - first - last) / (last - first);
    float half_width = 0.5 * (last - first);
    // Rounded at the biting edge, the side teeth shorter as they recede.
    float length_of = upper ? 0.112 - 0.012 * float(tooth == 1) - 0.022 * float(tooth > 2)
                            : 0.090 - 0.016 * float(tooth > 2);
    float rounding = (tooth == 2 ? 0.014 : 0.007) * pow(abs(across), tooth == 2 ? 2.0 : 4.0);
    float edge = rounding + (upper ? 0.010 * float(tooth == 1) + 0.10 * side * side
                                   : 0.03 * side * side);
    float root = length_of - 0.016 * across * across;
    float here = smoothstep(-soft, soft, y - edge);
    float in_gum = smoothstep(-0.006 - soft, 0.006 + soft, y - root);
    // The arch turns away to the sides; each tooth is a little cylinder.
    float arch = 1.0 - 0.62 * smoothstep(0.05, 0.33, side);
    float bulge = 1.0 - 0.12 * across * across;
    float gap = half_width * (1.0 - abs(across));
    float between = mix(0.72, 1.0, smoothstep(0.0, 0.005 + soft, gap));
    float tip = mix(0.90, 1.0, smoothstep(0.0, 0.03, y - edge));
    return vec3(here, in_gum, arch * bulge * between * tip);
}

void main() {
    float soft = max(0.7 * pixel, 0.002);
    float open = lips.x + lips.y;
    // Light falls in between the lips: the wider they part, the deeper.
    float under_upper = smoothstep(-0.01, 0.05, lips.x);
    float over_lower = smoothstep(-0.015, 0.04, lips.y);
    float light = mix(0.52, 1.0, under_upper) * mix(0.70, 1.0, over_lower);

    vec3 sum = cavity * mix(0.75, 1.15, over_lower);

    // The tongue lies behind the lower teeth and goes down with them, not as far.
    float back = 0.80 * jaw - 0.012 - 0.075 * raised;
    float hump = back + 0.70 * at.x * at.x;
    float on_tongue = smoothstep(-0.012 - soft, 0.012 + soft, at.y - hump);
    float groove = 1.0 - 0.16 * exp(-at.x * at.x / 0.0012);
    float far = mix(0.42, 1.0, smoothstep(0.0, 0.085, at.y - hump + 0.05 * raised));
    on_tongue *= smoothstep(0.24, 0.17, abs(at.x));
    sum = mix(sum, shaded(tongue, far * groove * mix(0.8, 1.0, over_lower)), on_tongue);

    // Lower teeth: from their biting edge down into the jaw.
    vec3 low = row(at.x, at.y - (jaw - 0.004), false, soft);
    vec3 tint = mix(teeth * 0.92, gum * 0.85, low.y);
    float shade = 0.92 * low.z * light;
    sum = mix(sum, shaded(tint, shade), low.x);

    // Upper teeth: from their biting edge up.
    vec3 up = row(at.x, 0.020 - at.y, true, soft);
    tint = mix(teeth, gum, up.y);
    sum = mix(sum, shaded(tint, up.z * light), up.x);

    // What is deepest is hardly lit where the lips are only just apart.
    sum *= mix(0.40, 1.0, smoothstep(0.0, 0.035, open));
    // A pixel at a lip's edge is partly the lip's.
    float inside = clamp(lips.x / pixel, 0.0, 1.0) * clamp(lips.y / pixel, 0.0, 1.0);
    colour = vec4(clamp(sum / 255.0, 0.0, 1.0), inside);
}
"""
