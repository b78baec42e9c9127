//! Nodes and weights of commutator-free Magnus methods, at Gauss points.
//!
//!     order 2        a = 1
//!     order 4        two exponentials: a_1 = (1/4 + √3/6, 1/4 − √3/6); three, which are more accurate at three nodes
//!     orders 6, 8    five and eight exponentials
//!
//! Weights are those of the first half; others are the mirror image, a_{J+1−j, K+1−k}. Negative ones cost phase: Σ |Σ_k a_jk|
//! is 1, 1, 1.19 and 2.74. Sources: blanesmoan2006; alvermann2011; hofstatter2019.

/// The nodes c, and the weights a of each exponential, first to last.
#[derive(Clone, Debug, PartialEq)]
pub struct Nodes {
    /// Order in h.
    pub order: usize,
    /// c_j
    pub nodes: Vec<f64>,
    /// a_kj
    pub rows: Vec<Vec<f64>>,
}

const SIX: [[f64; 3]; 3] = [
    [
        0.203_952_578_716_322_97,
        -0.059_581_898_090_477_95,
        0.015_629_319_374_154_987,
    ],
    [
        0.133_906_069_544_897_73,
        0.314_511_533_222_505_75,
        -0.060_893_550_742_091_63,
    ],
    [
        -0.014_816_639_115_506_27,
        -0.065_414_825_819_611_2,
        -0.014_816_639_115_506_27,
    ],
];

const EIGHT: [[f64; 4]; 4] = [
    [
        0.184_808_462_624_313_05,
        -0.020_720_662_120_200_42,
        0.005_027_118_679_539_855_5,
        -0.001_028_828_253_656_749_5,
    ],
    [
        -0.023_449_478_870_118_903,
        0.421_259_009_948_623_25,
        -0.047_487_898_633_259_765,
        0.009_044_788_136_196_184,
    ],
    [
        0.044_620_360_923_617_01,
        -0.212_369_356_865_717_37,
        0.569_989_517_802_253_9,
        0.006_029_846_782_669_974,
    ],
    [
        -0.049_375_251_573_536_776,
        0.232_989_476_865_882_56,
        -0.622_614_628_245_849,
        0.003_277_522_799_243_153_6,
    ],
];

/// Gauss points on [−1, 1], below the middle.
fn gauss(count: usize) -> Vec<f64> {
    let below = match count {
        1 => vec![],
        2 => vec![(1.0_f64 / 3.0).sqrt()],
        3 => vec![0.6_f64.sqrt()],
        _ => {
            let root = 2.0 / 7.0 * 1.2_f64.sqrt();
            vec![(3.0 / 7.0 + root).sqrt(), (3.0 / 7.0 - root).sqrt()]
        }
    };
    let middle = (count % 2 == 1).then_some(0.0);
    let above = below.iter().rev().copied();
    below
        .iter()
        .map(|x| -x)
        .chain(middle)
        .chain(above)
        .collect()
}

impl Nodes {
    /// The method of an order with so many exponentials; none if there is none.
    pub fn find(order: usize, exponentials: usize) -> Option<Self> {
        let half: Vec<Vec<f64>> = match (order, exponentials) {
            (2, 1) => vec![vec![1.0]],
            (4, 2) => {
                let apart = 3.0_f64.sqrt() / 6.0;
                vec![vec![0.25 + apart, 0.25 - apart]]
            }
            (4, 3) => {
                let (near, apart) = (37.0 / 240.0, 10.0 / 87.0 * (5.0_f64 / 3.0).sqrt());
                let side = -11.0 / 360.0;
                vec![
                    vec![near + apart, -1.0 / 30.0, near - apart],
                    vec![side, 23.0 / 45.0, side],
                ]
            }
            (6, 5) => SIX.iter().map(|row| row.to_vec()).collect(),
            (8, 8) => EIGHT.iter().map(|row| row.to_vec()).collect(),
            _ => return None,
        };
        let mut rows = half.clone();
        for row in half.iter().rev().skip(exponentials % 2) {
            rows.push(row.iter().rev().copied().collect());
        }
        let points = gauss(rows[0].len());
        Some(Self {
            order,
            nodes: points.iter().map(|x| 0.5 + 0.5 * x).collect(),
            rows,
        })
    }
}
