//! The chemical elements: their symbols, van der Waals radii and colours.

use glam::Vec3;

use crate::scene::srgb::decode;

/// How an element is shown.
struct Element {
    symbol: &'static str,
    /// Its van der Waals radius in ångströms.
    radius: f32,
    /// Its colour on the sRGB curve, as 0xRRGGBB.
    colour: u32,
}

const fn element(symbol: &'static str, radius: f32, colour: u32) -> Element {
    Element { symbol, radius, colour }
}

/// The elements by atomic number, from hydrogen (1) at index 0.
///
/// Radii: A. Bondi, "van der Waals Volumes and Radii", J. Phys. Chem. 68 (1964) 441, for the
/// main-group elements listed there; for all others S. Alvarez, "A cartography of the van der Waals
/// territories", Dalton Trans. 42 (2013) 8617; and 2 for elements that neither lists. Colours:
/// those of Jmol, which extend the colours of the models of Corey, Pauling and Koltun (CPK). Jmol
/// has none beyond meitnerium; heavier elements are given meitnerium's colour.
#[rustfmt::skip]
const ELEMENTS: [Element; 118] = [
    element("H", 1.20, 0xffffff),
    element("He", 1.40, 0xd9ffff),
    element("Li", 1.82, 0xcc80ff),
    element("Be", 1.98, 0xc2ff00),
    element("B", 1.91, 0xffb5b5),
    element("C", 1.70, 0x909090),
    element("N", 1.55, 0x3050f8),
    element("O", 1.52, 0xff0d0d),
    element("F", 1.47, 0x90e050),
    element("Ne", 1.54, 0xb3e3f5),
    element("Na", 2.27, 0xab5cf2),
    element("Mg", 1.73, 0x8aff00),
    element("Al", 2.25, 0xbfa6a6),
    element("Si", 2.10, 0xf0c8a0),
    element("P", 1.80, 0xff8000),
    element("S", 1.80, 0xffff30),
    element("Cl", 1.75, 0x1ff01f),
    element("Ar", 1.88, 0x80d1e3),
    element("K", 2.75, 0x8f40d4),
    element("Ca", 2.62, 0x3dff00),
    element("Sc", 2.58, 0xe6e6e6),
    element("Ti", 2.46, 0xbfc2c7),
    element("V", 2.42, 0xa6a6ab),
    element("Cr", 2.45, 0x8a99c7),
    element("Mn", 2.45, 0x9c7ac7),
    element("Fe", 2.44, 0xe06633),
    element("Co", 2.40, 0xf090a0),
    element("Ni", 2.40, 0x50d050),
    element("Cu", 2.38, 0xc88033),
    element("Zn", 2.39, 0x7d80b0),
    element("Ga", 1.87, 0xc28f8f),
    element("Ge", 2.29, 0x668f8f),
    element("As", 1.85, 0xbd80e3),
    element("Se", 1.90, 0xffa100),
    element("Br", 1.85, 0xa62929),
    element("Kr", 2.02, 0x5cb8d1),
    element("Rb", 3.21, 0x702eb0),
    element("Sr", 2.84, 0x00ff00),
    element("Y", 2.75, 0x94ffff),
    element("Zr", 2.52, 0x94e0e0),
    element("Nb", 2.56, 0x73c2c9),
    element("Mo", 2.45, 0x54b5b5),
    element("Tc", 2.44, 0x3b9e9e),
    element("Ru", 2.46, 0x248f8f),
    element("Rh", 2.44, 0x0a7d8c),
    element("Pd", 2.15, 0x006985),
    element("Ag", 2.53, 0xc0c0c0),
    element("Cd", 2.49, 0xffd98f),
    element("In", 1.93, 0xa67573),
    element("Sn", 2.17, 0x668080),
    element("Sb", 2.47, 0x9e63b5),
    element("Te", 2.06, 0xd47a00),
    element("I", 1.98, 0x940094),
    element("Xe", 2.16, 0x429eb0),
    element("Cs", 3.48, 0x57178f),
    element("Ba", 3.03, 0x00c900),
    element("La", 2.98, 0x70d4ff),
    element("Ce", 2.88, 0xffffc7),
    element("Pr", 2.92, 0xd9ffc7),
    element("Nd", 2.95, 0xc7ffc7),
    element("Pm", 2.00, 0xa3ffc7),
    element("Sm", 2.90, 0x8fffc7),
    element("Eu", 2.87, 0x61ffc7),
    element("Gd", 2.83, 0x45ffc7),
    element("Tb", 2.79, 0x30ffc7),
    element("Dy", 2.87, 0x1fffc7),
    element("Ho", 2.81, 0x00ff9c),
    element("Er", 2.83, 0x00e675),
    element("Tm", 2.79, 0x00d452),
    element("Yb", 2.80, 0x00bf38),
    element("Lu", 2.74, 0x00ab24),
    element("Hf", 2.63, 0x4dc2ff),
    element("Ta", 2.53, 0x4da6ff),
    element("W", 2.57, 0x2194d6),
    element("Re", 2.49, 0x267dab),
    element("Os", 2.48, 0x266696),
    element("Ir", 2.41, 0x175487),
    element("Pt", 2.29, 0xd0d0e0),
    element("Au", 2.32, 0xffd123),
    element("Hg", 2.45, 0xb8b8d0),
    element("Tl", 1.96, 0xa6544d),
    element("Pb", 2.02, 0x575961),
    element("Bi", 2.54, 0x9e4fb5),
    element("Po", 2.00, 0xab5c00),
    element("At", 2.00, 0x754f45),
    element("Rn", 2.00, 0x428296),
    element("Fr", 2.00, 0x420066),
    element("Ra", 2.00, 0x007d00),
    element("Ac", 2.80, 0x70abfa),
    element("Th", 2.93, 0x00baff),
    element("Pa", 2.88, 0x00a1ff),
    element("U", 2.71, 0x008fff),
    element("Np", 2.82, 0x0080ff),
    element("Pu", 2.81, 0x006bff),
    element("Am", 2.83, 0x545cf2),
    element("Cm", 3.05, 0x785ce3),
    element("Bk", 3.40, 0x8a4fe3),
    element("Cf", 3.05, 0xa136d4),
    element("Es", 2.70, 0xb31fd4),
    element("Fm", 2.00, 0xb31fba),
    element("Md", 2.00, 0xb30da6),
    element("No", 2.00, 0xbd0d87),
    element("Lr", 2.00, 0xc70066),
    element("Rf", 2.00, 0xcc0059),
    element("Db", 2.00, 0xd1004f),
    element("Sg", 2.00, 0xd90045),
    element("Bh", 2.00, 0xe00038),
    element("Hs", 2.00, 0xe6002e),
    element("Mt", 2.00, 0xeb0026),
    element("Ds", 2.00, 0xeb0026),
    element("Rg", 2.00, 0xeb0026),
    element("Cn", 2.00, 0xeb0026),
    element("Nh", 2.00, 0xeb0026),
    element("Fl", 2.00, 0xeb0026),
    element("Mc", 2.00, 0xeb0026),
    element("Lv", 2.00, 0xeb0026),
    element("Ts", 2.00, 0xeb0026),
    element("Og", 2.00, 0xeb0026),
];

/// A chemical element by its atomic number, or 0 for an unknown one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kind(u8);

impl Kind {
    /// No known element, such as the particles of a simulation.
    pub(super) const UNKNOWN: Kind = Kind(0);

    /// The radius and colour of atoms of no known element, which Jmol shows in pink.
    const UNKNOWN_ELEMENT: Element = element("", 2.0, 0xff1493);

    /// The unknown element and then all elements, so that each is at its
    /// [`index`](Self::index).
    pub(super) fn all() -> impl Iterator<Item = Kind> {
        (0..=ELEMENTS.len() as u8).map(Kind)
    }

    /// The position in [`Kind::all`].
    pub(super) fn index(self) -> usize {
        self.0.into()
    }

    /// The element of this atomic number.
    pub(super) fn of_number(number: u32) -> Option<Kind> {
        u8::try_from(number).ok().filter(|number| (1..=ELEMENTS.len() as u8).contains(number)).map(Kind)
    }

    /// The element of a symbol in upper or lower case. D and T are hydrogen.
    pub(super) fn of_symbol(symbol: &[u8]) -> Option<Kind> {
        match symbol {
            // Shortcuts for the most frequent elements.
            b"H" => return Some(Kind(1)),
            b"C" => return Some(Kind(6)),
            b"N" => return Some(Kind(7)),
            b"O" => return Some(Kind(8)),
            b"D" | b"T" => return Some(Kind(1)),
            _ => {}
        }
        let index = ELEMENTS.iter().position(|element| element.symbol.as_bytes().eq_ignore_ascii_case(symbol))?;
        Some(Kind(index as u8 + 1))
    }

    /// The element of the label of an atom, which begins with its symbol: `Fe`, `FE2+`, `C12`,
    /// or `OW`, where `Ow` is no element but `O` is. [`Kind::UNKNOWN`] if the label begins with no
    /// symbol.
    pub(super) fn of_label(label: &[u8]) -> Kind {
        let letters = label.iter().take(2).take_while(|byte| byte.is_ascii_alphabetic()).count();
        let candidates = (1..=letters).rev().map(|length| &label[..length]);
        candidates.into_iter().find_map(Kind::of_symbol).unwrap_or(Kind::UNKNOWN)
    }

    fn element(self) -> &'static Element {
        self.index().checked_sub(1).map_or(&Self::UNKNOWN_ELEMENT, |index| &ELEMENTS[index])
    }

    /// The van der Waals radius in ångströms.
    pub(super) fn radius(self) -> f32 {
        self.element().radius
    }

    /// The colour in linear light.
    pub(super) fn colour(self) -> Vec3 {
        let [_, levels @ ..] = self.element().colour.to_be_bytes();
        Vec3::from_array(levels.map(|level| decode(f64::from(level) / 255.0) as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::{ELEMENTS, Kind};

    #[test]
    fn labels_begin_with_the_symbol_of_their_element() {
        let symbol = |label: &str| Kind::of_label(label.as_bytes()).element().symbol;
        let labels = [
            ("C", "C"),
            ("c", "C"),
            ("Cl", "Cl"),
            ("CL1", "Cl"),
            ("C12", "C"),
            ("FE2+", "Fe"),
            ("OW", "O"),
            ("D", "H"),
            ("CB", "C"),
            ("U", "U"),
            ("X", ""),
            ("7", ""),
            ("", ""),
            ("\u{e5}", ""),
        ];
        for (label, expected) in labels {
            assert_eq!(symbol(label), expected, "{label}");
        }
    }

    #[test]
    fn every_element_has_its_number_a_radius_and_a_colour() {
        for (number, element) in (1..).zip(&ELEMENTS) {
            let kind = Kind::of_number(number).unwrap();
            assert_eq!(Kind::of_symbol(element.symbol.as_bytes()), Some(kind));
            assert!((1.0..=3.5).contains(&kind.radius()), "{}", element.symbol);
            assert!(kind.colour().max_element() <= 1.0 && kind.colour().max_element() > 0.05, "{}", element.symbol);
        }
        assert_eq!((Kind::of_number(0), Kind::of_number(119)), (None, None));
        // Hydrogen is white, oxygen red, nitrogen blue.
        let colour = |symbol: &[u8]| Kind::of_symbol(symbol).unwrap().colour();
        assert_eq!(colour(b"H").to_array(), [1.0; 3]);
        assert!(colour(b"O").x > 0.9 && colour(b"O").y < 0.01 && colour(b"N").z > 0.9);
    }
}
