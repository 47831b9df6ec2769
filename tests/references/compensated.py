"""A plugin of Mitsuba 3 for references: its rough conductor of reflectance 1 with the light that meets several facets (Kulla and
Conty 2017, "Revisiting physically based shading at Imageworks"), whose albedos are found by sampling that conductor."""
import math

import drjit as dr
import mitsuba as mi
import numpy as np


def masking(alpha, cosine):
    """Smith's masking of one direction. Mitsuba multiplies those of both; here they are correlated by height (Heitz 2014)."""
    tan2 = 1.0 / (cosine * cosine) - 1.0
    root = (1.0 + alpha * alpha * tan2) ** 0.5
    return 2.0 / (1.0 + root)


def register():
    """Registers the plugin for the variant that is set."""

    class Compensated(mi.BSDF):
        NODES, GRID, NESTED = 64, 1024, 0.9

        def __init__(self, props):
            mi.BSDF.__init__(self, props)
            rough = {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": props["alpha"]}
            self.alpha = props["alpha"]
            self.nested = mi.load_dict(rough)
            self.m_components = [mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide]
            self.m_flags = self.m_components[0]
            cosines = np.maximum(np.linspace(0.0, 1.0, self.NODES), 1e-3)
            count = self.GRID**2
            cell = np.arange(count)
            pair = (np.stack([cell % self.GRID, cell // self.GRID]) + 0.5) / self.GRID
            albedo = []
            for cosine in cosines.tolist():
                hit = dr.zeros(mi.SurfaceInteraction3f, count)
                hit.wi = mi.Vector3f(math.sqrt(1.0 - cosine * cosine), 0.0, cosine)
                _, weight = self.nested.sample(mi.BSDFContext(), hit, mi.Float(0.5), mi.Point2f(pair))
                here, there = masking(self.alpha, cosine), np.array(weight.x)
                seen = there > 0.0
                kept = np.where(seen, 1.0 / (1.0 + here * (1.0 / np.where(seen, there, 1.0) - 1.0)), 0.0)
                albedo.append(float(kept.mean()))
            lost = 1.0 - np.array(albedo)
            self.lost = mi.Float(lost)
            fine = (np.arange(4096) + 0.5) / 4096
            self.mean = float(2.0 * (fine * np.interp(fine, np.linspace(0.0, 1.0, self.NODES), lost)).mean())

        def lost_at(self, cosine, active):
            x = dr.clip(cosine, 0.0, 1.0) * (self.NODES - 1)
            node = dr.minimum(mi.UInt32(x), self.NODES - 2)
            low, high = (dr.gather(mi.Float, self.lost, node + k, active) for k in (0, 1))
            return low + (high - low) * (x - mi.Float(node))

        def sample(self, context, hit, choice, pair, active=True):
            chosen, _ = self.nested.sample(context, hit, choice, pair, active)
            by_facet = choice < self.NESTED
            chosen.wo = dr.select(by_facet, chosen.wo, mi.warp.square_to_cosine_hemisphere(pair))
            value, chosen.pdf = self.eval_pdf(context, hit, chosen.wo, active)
            chosen.eta, chosen.sampled_component = 1.0, 0
            chosen.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
            keep = active & (chosen.pdf > 0.0)
            return chosen, dr.select(keep, value / chosen.pdf, 0.0)

        def eval(self, context, hit, wo, active=True):
            up = active & (mi.Frame3f.cos_theta(hit.wi) > 0.0) & (mi.Frame3f.cos_theta(wo) > 0.0)
            there, back = (self.lost_at(mi.Frame3f.cos_theta(w), up) for w in (hit.wi, wo))
            several = there * back / (math.pi * self.mean) * mi.Frame3f.cos_theta(wo)
            o, i = (masking(self.alpha, mi.Frame3f.cos_theta(w)) for w in (hit.wi, wo))
            together = 1.0 / (o + i - o * i)
            return dr.select(up, self.nested.eval(context, hit, wo, active) * together + several, 0.0)

        def pdf(self, context, hit, wo, active=True):
            up = active & (mi.Frame3f.cos_theta(hit.wi) > 0.0) & (mi.Frame3f.cos_theta(wo) > 0.0)
            facet, cosine = self.nested.pdf(context, hit, wo, active), mi.Frame3f.cos_theta(wo) / math.pi
            return dr.select(up, self.NESTED * facet + (1.0 - self.NESTED) * cosine, 0.0)

        def eval_pdf(self, context, hit, wo, active=True):
            return self.eval(context, hit, wo, active), self.pdf(context, hit, wo, active)

    mi.register_bsdf("compensated", lambda props: Compensated(props))
