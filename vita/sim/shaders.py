"""The GLSL programs. Colours are squared on the way in and rooted on the way out (a gamma of 2).

Light is computed per vertex: robots have many small triangles and printed things are flat, so that it
looks the same as light per pixel, and on software OpenGL everything handed from vertex to pixel costs.
"""

# A cool sky from above, a warm bounce from below, one key and one weak fill light, a faint highlight.
_LIGHT = """
#version 330
uniform mat4 clip_from_body;
uniform mat4 world_from_body;
uniform vec3 eye;
in vec3 position;
in vec3 normal;
in vec3 color;
const vec3 KEY = normalize(vec3(0.55, -0.35, 1.0));
const vec3 FILL = normalize(vec3(0.30, 0.90, 0.35));
vec4 lit() {
    vec3 n = mat3(world_from_body) * normal;
    vec3 ambient = mix(vec3(0.23, 0.21, 0.19), vec3(0.40, 0.42, 0.46), 0.5 + 0.5 * n.z);
    vec3 light = ambient + 0.62 * max(dot(n, KEY), 0.0) + vec3(0.17, 0.18, 0.20) * max(dot(n, FILL), 0.0);
    vec3 towards = normalize(eye - (world_from_body * vec4(position, 1.0)).xyz);
    float shine = pow(max(dot(n, normalize(KEY + towards)), 0.0), 32.0);
    gl_Position = clip_from_body * vec4(position, 1.0);
    return vec4(color * color * light, 0.09 * shine);
}
"""

PLAIN = (
    _LIGHT
    + """
out vec3 shade;
void main() {
    vec4 light = lit();
    shade = sqrt(light.rgb + light.a);
}
""",
    """
#version 330
in vec3 shade;
out vec4 pixel;
void main() { pixel = vec4(shade, 1.0); }
""",
)

PRINTED = (
    _LIGHT
    + """
in vec2 uv;
out vec3 shade;
out vec2 texel;
void main() {
    // The root of a product is the product of the roots, so that the picture is used as it is.
    shade = sqrt(lit().rgb);
    texel = uv;
}
""",
    """
#version 330
uniform sampler2D picture;
uniform float sharpen;
in vec3 shade;
in vec2 texel;
out vec4 pixel;
void main() { pixel = vec4(shade * texture(picture, texel, sharpen).rgb, 1.0); }
""",
)

# The distance is linear in world coordinates, so that it is exact on slanted surfaces too.
METRIC = (
    """
#version 330
uniform mat4 clip_from_body;
uniform vec4 distance_from_body;
in vec3 position;
out float ahead;
void main() {
    gl_Position = clip_from_body * vec4(position, 1.0);
    ahead = dot(distance_from_body, vec4(position, 1.0));
}
""",
    """
#version 330
in float ahead;
out float distance_m;
void main() { distance_m = ahead; }
""",
)

BACKDROP = (
    """
#version 330
uniform mat3 world_from_ndc;
out vec3 ray;
void main() {
    vec2 ndc = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
    gl_Position = vec4(ndc, 1.0, 1.0);
    ray = world_from_ndc * vec3(ndc, 1.0);
}
""",
    """
#version 330
in vec3 ray;
out vec4 pixel;
void main() {
    float up = normalize(ray).z;
    vec3 wall = mix(vec3(0.80, 0.81, 0.82), vec3(0.62, 0.69, 0.77), smoothstep(-0.1, 0.8, up));
    pixel = vec4(mix(vec3(0.56, 0.55, 0.54), wall, smoothstep(-0.35, 0.0, up)), 1.0);
}
""",
)
