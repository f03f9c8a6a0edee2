// Diffuse transmission for three.js, whose GLTFLoader (r187) does not read KHR_materials_diffuse_transmission:
//     loader.register((parser) => new DiffuseTransmission(parser))
// Light of lamps on the other side of a surface comes through it. Left out: light of the surroundings.
const NAME = "KHR_materials_diffuse_transmission";

const PARS = `
uniform float diffuseTransmission;
uniform vec3 diffuseTransmissionColor;
#ifdef USE_DIFFUSE_TRANSMISSION_MAP
uniform sampler2D diffuseTransmissionColorMap;
#endif
vec3 transmittedColor = vec3( 0.0 );
void RE_Direct_Through( const in IncidentLight light, const in vec3 position, const in vec3 normal, const in vec3 viewDir, const in vec3 clearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
	RE_Direct_Physical( light, position, normal, viewDir, clearcoatNormal, material, reflectedLight );
	float behind = saturate( - dot( normal, light.direction ) );
	vec3 through = behind * light.color * BRDF_Lambert( transmittedColor );
	#ifdef USE_SHEEN
	through *= 1.0 - max3( material.sheenColor ) * IBLSheenBRDF( normal, viewDir, material.sheenRoughness );
	#endif
	reflectedLight.directDiffuse += through;
}
#undef RE_Direct
#define RE_Direct RE_Direct_Through
`;

const COLOR = `
transmittedColor = diffuseTransmission * diffuseTransmissionColor;
#ifdef USE_DIFFUSE_TRANSMISSION_MAP
transmittedColor *= texture2D( diffuseTransmissionColorMap, vMapUv ).rgb;
#endif
material.diffuseContribution *= 1.0 - diffuseTransmission;
material.diffuseColor *= 1.0 - diffuseTransmission;
`;

export class DiffuseTransmission {
  constructor(parser) {
    this.parser = parser;
    this.name = NAME;
  }

  async extendMaterialParams(index, params) {
    const extension = this.parser.json.materials[index].extensions?.[NAME];
    if (!extension) return;
    const values = {};
    if (extension.diffuseTransmissionColorTexture) {
      const colors = { colorSpace: "srgb" };
      await this.parser.assignTexture(values, "map", extension.diffuseTransmissionColorTexture, colors.colorSpace);
    }
    const color = extension.diffuseTransmissionColorFactor ?? [1, 1, 1];
    params.defines = { STANDARD: "", PHYSICAL: "", ...(values.map ? { USE_DIFFUSE_TRANSMISSION_MAP: "" } : {}) };
    params.onBeforeCompile = (shader) => {
      shader.uniforms.diffuseTransmission = { value: extension.diffuseTransmissionFactor ?? 0 };
      shader.uniforms.diffuseTransmissionColor = { value: color };
      shader.uniforms.diffuseTransmissionColorMap = { value: values.map };
      shader.fragmentShader = shader.fragmentShader
        .replace("#include <lights_physical_pars_fragment>", `#include <lights_physical_pars_fragment>\n${PARS}`)
        .replace("#include <lights_physical_fragment>", `#include <lights_physical_fragment>\n${COLOR}`);
    };
  }
}
